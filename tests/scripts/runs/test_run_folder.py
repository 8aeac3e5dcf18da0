"""The run folder: what goes in comes out, also when it was cut off anywhere."""

import math
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.hw.api import ConfigError
from endolock.scripts.figures import rerun_export, strip
from endolock.scripts.runs import log_tables, run_folder
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.sealed_table import TableWriter


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "run"
    Experiment(scenario="straight", duration_s=1.5, out=path).run()
    return path


def test_rows_stand_for_ticks_and_frames(folder: Path) -> None:
    ticks, frames = run_folder.read(folder, "ticks"), run_folder.read(folder, "frames")
    assert len(ticks) == 76  # 0, 0.02, ... 1.5 s
    assert frames["seq"].to_pylist() == list(range(28))  # the last arrives at 0.4 + 27 * 0.04 s
    assert frames["status"].unique().to_pylist() == ["tracking"]
    picture = log_tables.decode(frames["tip_jpeg"][0].as_py())
    assert picture.shape == (480, 640, 3)
    assert picture[240, 320].tolist() != picture[20, 20].tolist()
    assert log_tables.decode(frames["overview_jpeg"][0].as_py()).shape == (360, 480, 3)


def test_frames_hold_the_rotation_of_the_camera(folder: Path) -> None:
    frames = run_folder.read(folder, "frames")
    since, turns, std = (
        frames[name].to_pylist() for name in ("turn_since_s", "turn_rad", "turn_std_rad")
    )
    assert (since[0], turns[0], std[0]) == (None, None, None)  # nothing is before the first frame
    assert since[1:] == pytest.approx(frames["t_capture"].to_pylist()[:-1])
    # pi at rest turns the tip by less than a degree a frame
    assert np.abs(turns[1:]).max() < 0.02
    assert 0 < np.min(std[1:]) < np.max(std[1:]) < 1e-3


def test_a_folder_without_later_columns_is_read(folder: Path, tmp_path: Path) -> None:
    """A table as earlier versions wrote it has no rotations; the rest is the same."""
    whole = run_folder.read(folder, "frames")
    earlier = whole.drop_columns(list(log_tables.LATER))
    writer = TableWriter(tmp_path / "frames.arrows", earlier.schema, 8)
    for row in earlier.to_pylist():
        writer.append(row)
    writer.close()
    read = run_folder.read(tmp_path, "frames")
    assert read.schema.equals(log_tables.FRAMES)
    assert read.drop_columns(list(log_tables.LATER)).equals(earlier)
    assert all(read[name].null_count == len(read) for name in log_tables.LATER)


def test_the_configuration_says_what_was_run(folder: Path) -> None:
    configuration = tomllib.loads((folder / "run.toml").read_text())
    assert configuration["run"]["controller"] == "pi"
    assert configuration["scenario"]["camera"]["latency_s"] == 0.4
    assert configuration["scenario"]["duration_s"] == 1.5
    assert configuration["instrument"]["slack_m"] == -0.00375
    assert configuration["calibration"]["width"] == 640
    assert set(run_folder.PACKAGES) < set(configuration["versions"])


@settings(max_examples=40)
@given(data=st.data())
@pytest.mark.parametrize("table", ["ticks", "frames"])
def test_a_table_cut_anywhere_is_read_up_to_a_whole_row(
    table: str, data: st.DataObject, folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    whole = (folder / f"{table}.arrows").read_bytes()
    header = 4096  # the schema comes first; without it there is nothing to read
    size = data.draw(st.integers(header, len(whole)))
    place = tmp_path_factory.mktemp("cut")
    (place / f"{table}.arrows").write_bytes(whole[:size])
    cut, full = run_folder.read(place, table), run_folder.read(folder, table)
    assert cut.equals(full.slice(0, len(cut)))
    if size == len(whole):
        assert len(cut) == len(full)


def test_other_folders_are_refused_as_run_folders(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no run in .*: ticks.arrows is missing; give a run"):
        run_folder.read(tmp_path, "ticks")
    (tmp_path / "ticks.arrows").write_bytes(b"nonsense that is no table")
    with pytest.raises(ConfigError, match=r"cannot read .*ticks.arrows: .*; give a run folder"):
        run_folder.read(tmp_path, "ticks")


def test_the_recording_holds_pictures_curves_and_section(folder: Path) -> None:
    import rerun.chunk as chunk

    store = chunk.RrdReader(str(rerun_export.derive(folder))).stream().collect()
    entities = {str(path) for path in store.schema().entity_paths()}
    for path in [
        "/tip/picture",
        "/tip/centre",
        "/tip/target",
        "/tip/markers",
        "/overview/picture",
        "/error/now",
        "/error/seen",
        "/scores",
        "/handles/up_down/goal",
        "/handles/left_right/measured",
        "/wires/up",
        "/wires/left",
        "/world/section",
        "/world/board",
        "/world/tip",
    ]:
        assert path in entities


def test_the_strip_shows_the_run(folder: Path, tmp_path: Path) -> None:
    import cv2

    picture = cv2.imread(str(strip.write({"pi": folder}, tmp_path / "strip.png")))
    assert picture is not None
    both = {"pi": folder, "pi again": folder}
    pair = cv2.imread(str(strip.write(both, tmp_path / "pair.png")))
    assert pair is not None
    assert pair.shape == (2 * picture.shape[0], *picture.shape[1:])
    assert picture.shape[1] == strip.PICTURES * (strip.WIDTH_PX + 4) - 4
    assert picture.std() > 20  # neither black nor flat


def test_a_run_without_pictures_has_no_strip(tmp_path: Path) -> None:
    path = tmp_path / "run"
    request = Experiment(scenario="rest", vision="truth", duration_s=0.5, out=path)
    request.run()
    rerun_export.derive(path)
    with pytest.raises(ConfigError, match="has no pictures; run it with vision markers"):
        strip.write({"pi": path}, tmp_path / "strip.png")


def test_the_recording_shows_what_the_tables_say(folder: Path) -> None:
    import rerun.chunk as chunk

    store = chunk.RrdReader(str(rerun_export.derive(folder))).stream().collect()
    values: dict[str, list[pa.RecordBatch]] = {}
    for piece in store.stream():
        batch = piece.to_record_batch()
        values.setdefault(str(piece.entity_path), []).append(batch)
    ticks, frames = run_folder.read(folder, "ticks"), run_folder.read(folder, "frames")
    handle = _column(values["/handles/left_right/measured"], "Scalars:scalars")
    expected = [math.degrees(row[1]) for row in ticks["position_rad"].to_pylist()]
    assert handle == pytest.approx(expected)
    turned = _column(values["/world/tip"], "Transform3D:quaternion")
    w, x, y, z = frames["tip_pose"][-1].as_py()[3:]
    assert turned[-4:] == pytest.approx([x, y, z, w], abs=1e-6)  # Rerun keeps single precision


def _column(batches: list[pa.RecordBatch], name: str) -> list[float]:
    """Numbers of one component, flat."""
    found = [batch.column(name) for batch in batches if name in batch.schema.names]
    return [float(v) for column in found for v in np.ravel(column.to_pylist())]


def test_rerun_itself_verifies_the_recording(folder: Path) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(rerun_export.derive(folder))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("table", ["ticks", "frames"])
def test_a_table_without_a_row_yet_is_empty(table: str, tmp_path: Path) -> None:
    (tmp_path / f"{table}.arrows").write_bytes(b"")
    assert len(run_folder.read(tmp_path, table)) == 0


def test_a_table_under_the_name_of_another_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "ticks.arrows").write_bytes((folder / "frames.arrows").read_bytes())
    with pytest.raises(
        ConfigError, match=r"ticks.arrows is not a table of ticks; give a run folder"
    ):
        run_folder.read(tmp_path, "ticks")


def test_a_full_disk_is_reported_in_one_line(tmp_path: Path) -> None:
    """A limit on the size of files stands for it."""
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000)); "
        "import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
        "from endolock.scripts import cli; sys.exit(cli.main(sys.argv[1:]))"
    )
    out = tmp_path / "run"
    command = [sys.executable, "-c", code, "run", "rest", "--duration-s", "5", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert f"endolock: cannot write {out}/frames.arrows" in done.stderr
    assert len(run_folder.read(out, "frames")) > 3
