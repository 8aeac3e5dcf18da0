"""The run folder: what goes in comes out, also when it was cut off anywhere."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.hw.api import ConfigError
from endolock.scripts import recorder, rrd, run, strip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "run"
    run.perform(run.Request(scenario="straight", duration_s=1.5, out=path), show_progress=False)
    return path


def test_rows_stand_for_ticks_and_frames(folder: Path) -> None:
    ticks, frames = recorder.read(folder, "ticks"), recorder.read(folder, "frames")
    assert len(ticks) == 76  # 0, 0.02, ... 1.5 s
    assert frames["seq"].to_pylist() == list(range(28))  # the last arrives at 0.4 + 27 * 0.04 s
    assert frames["status"].unique().to_pylist() == ["tracking"]
    picture = recorder.decode(frames["tip_jpeg"][0].as_py())
    assert picture.shape == (480, 640, 3)
    assert picture[240, 320].tolist() != picture[20, 20].tolist()
    assert recorder.decode(frames["overview_jpeg"][0].as_py()).shape == (360, 480, 3)


def test_the_configuration_says_what_was_run(folder: Path) -> None:
    told = tomllib.loads((folder / "run.toml").read_text())
    assert told["run"]["controller"] == "pi"
    assert told["scenario"]["camera"]["latency_s"] == 0.4
    assert told["scenario"]["duration_s"] == 1.5
    assert told["instrument"]["slack_m"] == -0.00375
    assert told["calibration"]["width"] == 640
    assert set(run.PACKAGES) < set(told["versions"])


@settings(max_examples=40, deadline=None)
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
    cut, full = recorder.read(place, table), recorder.read(folder, table)
    assert cut.equals(full.slice(0, len(cut)))
    if size == len(whole):
        assert len(cut) == len(full)


def test_what_is_no_run_folder_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no run in .*: ticks.arrows is missing; give a run"):
        recorder.read(tmp_path, "ticks")
    (tmp_path / "ticks.arrows").write_bytes(b"nonsense that is no table")
    with pytest.raises(ConfigError, match=r"cannot read .*ticks.arrows: .*; give a run folder"):
        recorder.read(tmp_path, "ticks")


def test_the_recording_holds_pictures_curves_and_section(folder: Path) -> None:
    import rerun.chunk as chunk

    store = chunk.RrdReader(str(rrd.derive(folder))).stream().collect()
    entities = {str(path) for path in store.schema().entity_paths()}
    for path in [
        "/tip/picture",
        "/tip/centre",
        "/tip/target",
        "/tip/markers",
        "/overview/picture",
        "/error/now",
        "/error/seen",
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

    picture = cv2.imread(str(strip.write(folder, tmp_path / "strip.png")))
    assert picture is not None
    assert picture.shape[1] == strip.PICTURES * (strip.WIDTH_PX + 4) - 4
    assert picture.std() > 20  # neither black nor flat


def test_a_run_without_pictures_has_no_strip(tmp_path: Path) -> None:
    path = tmp_path / "run"
    request = run.Request(scenario="rest", vision="truth", duration_s=0.5, out=path)
    run.perform(request, show_progress=False)
    rrd.derive(path)
    with pytest.raises(ConfigError, match="has no pictures; run it with --vision markers"):
        strip.write(path, tmp_path / "strip.png")
