"""A damaged run folder: whatever is whole is read, and what is not is said by every reader."""

import json
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pyarrow as pa
import pytest

from endolock import ConfigError, DamageWarning, Experiment, read_run
from endolock.hw.dynamixel import bus_log
from endolock.scripts import cli
from endolock.scripts.runs import bus_replay, folder_contents, run_folder, sealed_table

DAMAGED = Path(__file__).with_name("damaged_folders.py")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "run"
    Experiment(scenario="circle", rig="hil", latency_s=0.1, duration_s=0.7, out=path).run()
    return path


@pytest.fixture
def folder(whole: Path, tmp_path: Path) -> Path:
    path = tmp_path / "run"
    path.mkdir()
    for file in whole.iterdir():
        (path / file.name).write_bytes(file.read_bytes())
    return path


def damage_and_read(run: Path, seed: int, count: int, every: int) -> None:
    """In a process of its own: damaged bytes must not crash the interpreter either."""
    command = [sys.executable, str(DAMAGED), str(run), str(seed), str(count), str(every)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    last = done.stdout.splitlines()[-1:]
    assert done.returncode == 0, f"seed {seed}, {last}: rc {done.returncode}\n{done.stderr[-3000:]}"
    assert int(last[0].split()[1]) > 0.7 * count  # most damages hit something


def test_40_damages_are_read_or_said(whole: Path) -> None:
    damage_and_read(whole, 1, 40, 40)


@pytest.mark.slow
def test_500_new_damages_are_read_or_said_by_every_command(whole: Path) -> None:
    seed = time.time_ns() % 2**32
    print("seed", seed)
    damage_and_read(whole, seed, 500, 1)


def change(file: Path, position: int) -> None:
    data = bytearray(file.read_bytes())
    data[position] ^= 1
    file.write_bytes(data)


def test_a_group_in_the_middle_is_named_and_the_rest_read(folder: Path) -> None:
    file = folder / "frames.arrows"
    with file.open("rb") as source:
        group = sealed_table.groups(source, folder_contents.TABLES["frames"])[3]
    change(file, group.start + group.length // 2)
    expected = f"{file} row group 3 is damaged: rows 2 to 2 are missing"
    with pytest.warns(DamageWarning, match="row group 3 is damaged: rows 2 to 2 are missing"):
        run = read_run(folder)
    assert run.damage == (expected,)
    assert run.record is not None
    assert run.frames.num_rows == run.record.frames - 1


@pytest.mark.parametrize("table", ["ticks", "frames"])
def test_a_table_cut_short_ends_early_by_what_metrics_json_states(table: str, folder: Path) -> None:
    file = folder / f"{table}.arrows"
    rows = json.loads((folder / "metrics.json").read_text())["rows"][table]
    file.write_bytes(file.read_bytes()[:-60])
    with pytest.warns(DamageWarning, match=rf"ends early: \d+ of {rows} rows"):
        assert folder_contents.read(folder, table).num_rows < rows
    (folder / "metrics.json").unlink()  # a killed run is what it is
    assert 0 < folder_contents.read(folder, table).num_rows < rows
    assert folder_contents.damage(folder, table) == []


def test_commands_say_it_on_standard_error_and_in_their_json(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("frames.arrows", "bus.log"):
        file = folder / name
        file.write_bytes(file.read_bytes()[:-100])
    for command in ("watch", "bus"):
        assert cli.main([command, str(folder), "--json", "-"]) in (0, 2)
        out, err = capsys.readouterr()
        assert err.count("ends early") == 1  # once, however often it was read
        assert "endolock: warning: " in err
        assert any("ends early" in text for text in json.loads(out)["damage"])


def test_swapped_groups_are_put_back_in_order(folder: Path) -> None:
    file = folder / "ticks.arrows"
    before = folder_contents.read(folder, "ticks")
    with file.open("rb") as source:
        first, second = sealed_table.groups(source, before.schema)[2:4]
    data = file.read_bytes()
    parts = [data[g.start : g.start + g.length] for g in (second, first)]
    file.write_bytes(data[: first.start] + b"".join(parts) + data[second.start + second.length :])
    assert folder_contents.read(folder, "ticks").equals(before)


def test_a_changed_configuration_is_refused_unless_its_seal_is_removed(folder: Path) -> None:
    file = folder / "run.toml"
    text = file.read_text()
    file.write_text(text.replace("width = 640", "width = 641"))
    with pytest.raises(ConfigError, match="was changed since it was written; restore it, or"):
        read_run(folder)
    file.write_text("\n".join(file.read_text().splitlines()[1:-1]))
    assert read_run(folder).configuration["calibration"]["width"] == 641
    assert read_run(folder).damage == ()


@pytest.mark.parametrize("text", ['{"seed": 1', "", "[1, 2]", "\x00" * 40, "{}"])
def test_damaged_metrics_are_one_warning(text: str, folder: Path) -> None:
    (folder / "metrics.json").write_text(text)
    if text == "{}":  # of another version
        with pytest.raises(ConfigError, match="is not a run record of this version"):
            read_run(folder)
        return
    with pytest.warns(DamageWarning, match=r"metrics.json is damaged and was not used"):
        assert read_run(folder).record is None


def test_a_table_of_an_earlier_version_has_no_seals(folder: Path, tmp_path: Path) -> None:
    ticks = folder_contents.read(folder, "ticks")
    older = tmp_path / "older"
    older.mkdir()
    with pa.ipc.new_stream(str(older / "ticks.arrows"), ticks.schema) as writer:
        writer.write_table(ticks)
    assert folder_contents.read(older, "ticks").equals(ticks)


def test_a_log_of_an_earlier_version_has_no_check_sums(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    record = bytes.fromhex("000000000000e03f 01 0300 010203")  # 0.5 s, in, three bytes
    path.write_bytes(b"ENDOBUS1" + 2 * record + record[:-1])
    assert list(bus_log.read(path)) == 2 * [bus_log.Chunk(0.5, True, b"\x01\x02\x03")]


def test_any_arrow_reader_reads_a_table(whole: Path) -> None:
    plain = pa.ipc.open_stream(whole / "ticks.arrows").read_all()
    assert plain.equals(folder_contents.read(whole, "ticks"))


def test_of_two_runs_at_once_one_gets_the_folder(tmp_path: Path) -> None:
    first = run_folder.RunFolder(tmp_path / "run", {})
    with first, pytest.raises(ConfigError, match="is not empty; give a new one"):
        run_folder.RunFolder(tmp_path / "run", {})
    made = {run_folder.new_path(tmp_path / "runs", "same") for _ in range(5)}
    assert len(made) == 5  # in the same second
    assert all(path.is_dir() for path in made)
    with run_folder.series_folder(None, tmp_path / "runs", "other") as path:
        assert path.is_dir()
    assert not path.exists()  # nothing was run in it


def test_many_processes_at_once_get_folders_of_their_own(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from endolock.scripts.runs import run_folder; "
        "print('ready', flush=True); sys.stdin.readline(); "
        "print(*[run_folder.new_path(Path(sys.argv[1]), 'x') for _ in range(20)])"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "runs")]
    pipe = subprocess.PIPE
    processes = [subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) for _ in range(3)]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    paths = [path for process in processes for path in process.communicate()[0].split()]
    assert len(paths) == len(set(paths)) == 60


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("other") / "run"
    Experiment(
        scenario="straight", rig="hil", vision="truth", latency_s=0.1, duration_s=0.7, out=path
    ).run()
    return path


@pytest.mark.parametrize("name", ["run.toml", "ticks.arrows", "frames.arrows", "bus.log"])
def test_a_file_of_another_run_is_said(name: str, folder: Path, other: Path) -> None:
    (folder / name).write_bytes((other / name).read_bytes())
    said = f"{folder / name} and metrics.json are not of the same run"
    assert folder_contents.damage(folder) == [said]
    reader = folder_contents.bus_records if name == "bus.log" else read_run
    with pytest.warns(DamageWarning, match="not of the same run"):
        reader(folder)


def test_metrics_of_another_run_are_said_with_every_file(folder: Path, other: Path) -> None:
    (folder / "metrics.json").write_bytes((other / "metrics.json").read_bytes())
    assert len(folder_contents.damage(folder)) == 4


def test_a_configuration_without_its_seal_is_used_as_it_is(folder: Path) -> None:
    file = folder / "run.toml"
    file.write_text("\n".join(file.read_text().splitlines()[1:-1]))
    assert folder_contents.damage(folder) == []
    assert folder_contents.configuration(folder)["run"]["scenario"] == "circle"


def test_a_bus_log_is_replayed_from_any_record_on(folder: Path) -> None:
    """What comes before is lost, such as the goals that `enable()` sent, or the whole set-up."""
    (folder / "metrics.json").unlink()
    records = list(bus_log.read(folder / "bus.log"))
    sent = [n for n, record in enumerate(records) if not record.came_in]
    for first in sent[:: max(1, len(sent) // 25)]:
        (folder / "bus.log").unlink()
        with closing(bus_log.BusLog(folder / "bus.log")) as log:
            for record in records[first:]:
                log.append(*record)
        replayed = bus_replay.replay(folder)
        assert replayed.exchanges == sum(n >= first for n in sent)
