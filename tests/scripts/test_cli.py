"""The command line: the contract's keys, the messages a user can meet, and safe interruption."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from endolock.hw.api import ConfigError, DeviceFault
from endolock.scripts import cli, demo
from endolock.scripts.runs import log_tables, run_folder

RUN_KEYS = [
    "scenario",
    "controller",
    "rig",
    "instrument",
    "seed",
    "duration_s",
    "scored_from_s",
    "wall_s",
    "real_time_factor",
    "latency_s",
    "frames",
    "frames_dropped",
    "detected_fraction",
    "lost_fraction",
    "time_to_lock_s",
    "error_px",
    "error_deg",
    "delayed_error_px",
    "vision_error_px",
    "handle",
    "tip",
    "blur_px",
    "needed_tip_deg",
    "constant_px",
]
ERROR_KEYS = {"rms", "p95", "max", "mean", "within_20", "within_50"}
HANDLE_KEYS = {
    *("rate_rms", "accel_rms", "jerk_rms", "travel_rad", "p2p_deg"),
    *("reversals_per_s", "large_reversals_per_s", "fast_share"),
}
QUICK = ["run", "circle", "--vision", "truth", "--duration-s", "1.5"]


def test_json_on_standard_output_holds_every_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    args = ["run", "straight", "--duration-s", "1.5", "--out", str(out), "--json", "-"]
    assert cli.main(args) == 0
    record = json.loads(capsys.readouterr().out)  # nothing but JSON
    assert set(record) >= set(RUN_KEYS)
    assert set(record["error_px"]) == set(record["delayed_error_px"]) == ERROR_KEYS
    assert set(record["handle"]) == HANDLE_KEYS
    assert set(record["error_deg"]) == set(record["vision_error_px"]) == {"rms", "max"}
    assert record["lost_fraction"] == 0
    assert record["detected_fraction"] == 1
    kept = json.loads((out / "metrics.json").read_text())
    assert kept.pop("rows") == {"ticks": 76, "frames": 28}
    assert kept.pop("crc32")
    assert set(kept.pop("sums")) == {"ticks", "frames", "run"}
    assert record == kept
    files = {"run.toml", "ticks.arrows", "frames.arrows", "metrics.json", "run.rrd"}
    assert {file.name for file in out.iterdir()} == files


NOISY = """
import ctypes, os, subprocess, sys
from endolock import Command

def shout():
    print("print")
    sys.__stdout__.write("the first stdout\\n")
    os.write(1, b"the descriptor\\n")
    subprocess.run(["echo", "a child"])
    ctypes.CDLL(None).printf(b"C\\n")

shout()

class Law:
    def reset(self, state): shout()
    @property
    def signals(self): shout(); return {}
    def update(self, t, state, seen): shout(); return Command(position=(0.0, 0.0))

def make(calibration): shout(); return Law()
"""


def test_json_on_standard_output_is_alone_whatever_a_law_prints(tmp_path: Path) -> None:
    law = tmp_path / "noisy.py"
    law.write_text(NOISY)
    args = ["run", "rest", "--rig", "surrogate", "--vision", "truth", "--duration-s", "0.05"]
    args += ["--controller", str(law), "--out", str(tmp_path / "run"), "--json", "-"]
    done = _endolock(*args, env=dict(os.environ))
    assert done.returncode == 0
    assert json.loads(done.stdout)["controller"] == "noisy"
    for line in ("print", "the first stdout", "the descriptor", "a child", "C"):
        # when imported, made and reset, and at 3 ticks, whose commands have signals but the first's
        assert done.stderr.splitlines().count(line) == 3 + 3 + 2


def test_one_seed_gives_the_same_tables_and_metrics(tmp_path: Path) -> None:
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder in folders:
        args = ["run", "straight", "--duration-s", "1.5", "--seed", "4", "--out", str(folder)]
        assert cli.main(args) == 0
    for table in ("ticks", "frames"):
        first, second = ((folder / f"{table}.arrows").read_bytes() for folder in folders)
        assert first == second
    records = [json.loads((folder / "metrics.json").read_text()) for folder in folders]
    for record in records:
        del record["wall_s"], record["real_time_factor"]
        del (
            record["crc32"],
            record["sums"]["run"],
        )  # of all, and of run.toml, which names the folder
    assert records[0] == records[1]


def test_options_reach_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = [*QUICK, "--latency-s", "0.12", "--scored-from-s", "1", "--out", str(tmp_path / "run")]
    assert cli.main([*args, "--json", str(tmp_path / "run.json")]) == 0
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["latency_s"] == 0.12
    assert record["scored_from_s"] == 1
    # exposures at 0, 0.04, ... arrive 0.12 s later: the last by 1.5 s is the one of 1.36 s
    assert record["frames"] == 35
    assert "run folder:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ([], "Expected one of {run, compare, hysteresis, identify, latency"),
        (["runn"], "did you mean run?"),
        (["hysteresys", "--seed", "1"], "did you mean hysteresis?"),
        (["compare", "--controler", "pi"], "did you mean --controllers?"),
        (["latency", "--stroke=5"], "did you mean --strokes?"),
        (["run"], "Missing from endolock run: STR"),
        (["run", "rest", "--controler", "pi"], "did you mean --controller?"),
        (
            ["run", "rest", "--vary", "a=1", "--vary", "b=2"],
            "--vary is given 2 times; give it once",
        ),
        (["run", "rest", "--duration-s", "long"], "Error parsing --duration-s"),
        (
            ["run", "strait"],
            "scenario 'strait' is unknown; use breathing, circle, close, close_random",
        ),
        (
            ["run", "rest", "--controller", "pd"],
            "controller 'pd' is unknown; use ik, ik_sync, oracle, pi, pi_hc, pi_simc",
        ),
        (["run", "rest", "--rig", "car"], "rig 'car' is unknown; use twin"),
        (
            ["run", "rest", "--vision", "ears"],
            "vision 'ears' is unknown; use markers, track or truth",
        ),
        (
            ["run", "rest", "--instrument", "oboe"],
            "instrument 'oboe' is unknown; use",
        ),
        (["run", "rest", "--latency-s", "-1"], "camera.latency_s: got -1 s, wanted 0 to 5 s"),
        (["run", "rest", "--duration-s", "-1"], "duration_s: got -1 s, wanted 0.02 to 86400 s"),
        (["run", "rest", "--duration-s", "nan"], "duration_s: should be a finite number"),
        (["run", "rest", "--scored-from-s", "25"], "scored_from_s 25 is not before the end at 25"),
        (["run", "rest", "--seed", "-1"], "seed -1; use a whole number, 0 or more"),
        (["run", "rest", "--json", "nowhere/x.json"], "cannot write nowhere/x.json; give --json"),
        (["view", "nowhere"], "nowhere is not a folder; give a run folder"),
    ],
)
def test_bad_input_gives_one_line_and_leaves_nothing(
    args: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(args) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("endolock: ")
    assert message in said.err
    assert said.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_used_or_unwritable_folder_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.txt").write_text("precious")
    assert cli.main([*QUICK, "--out", str(tmp_path)]) == 2
    assert f"folder {tmp_path} is not empty; give a new one" in capsys.readouterr().err
    below_a_file = tmp_path / "mine.txt" / "run"
    assert cli.main([*QUICK, "--out", str(below_a_file)]) == 2
    assert f"cannot write to {below_a_file}: Not a directory" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]


def test_without_opengl_it_says_what_to_install(tmp_path: Path) -> None:
    """Device 99 exists nowhere, so this EGL cannot draw; the library itself loads."""
    environment = {**os.environ, "MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "99"}
    done = _endolock("run", "rest", "--out", str(tmp_path / "run"), env=environment)
    assert done.returncode == 2
    assert done.stderr.startswith(
        "endolock: cannot render a picture off-screen with MUJOCO_GL=egl ("
    )
    assert "apt install libegl1 libgl1" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "run").exists()
    args = [*QUICK, "--out", str(tmp_path / "run")]
    assert _endolock(*args, env=environment).returncode == 0  # truth needs no picture


@pytest.mark.parametrize("value", ["foo", "osmesa"])
def test_another_opengl_that_fails_is_named(value: str, tmp_path: Path) -> None:
    environment = {**os.environ, "MUJOCO_GL": value}
    done = _endolock("run", "rest", "--out", str(tmp_path / "run"), env=environment)
    if value == "osmesa" and done.returncode == 0:
        return  # it is installed here, and works
    assert done.returncode == 2
    assert f"MUJOCO_GL={value}" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (DeviceFault("motor 2 is hot; let it cool", kind="overheat", t=1.0), 3),
        (ConfigError("wanted this, got that"), 2),
        (KeyboardInterrupt(), 130),
    ],
)
def test_each_kind_of_error_has_its_exit_code(
    error: BaseException, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_args: list[str]) -> int:
        raise error

    assert cli.guarded(fail, []) == code
    assert capsys.readouterr().err == f"endolock: {str(error) or 'interrupted'}\n"


def test_a_closed_pipe_is_not_an_error(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "endolock.scripts.cli", *QUICK, "--json", "-"]
    with subprocess.Popen(
        [*command, "--out", str(tmp_path / "run")], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout
        assert process.stderr
        process.stdout.close()
        said = process.stderr.read().decode()
    assert process.returncode == 0
    assert "Traceback" not in said


def test_special_characters_in_names_are_printed_unchanged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "p[red]q[/x]"
    assert cli.main([*QUICK, "--out", str(out)]) == 0
    assert f"run folder: {out}" in capsys.readouterr().out.replace("\n", "")


def test_the_demo_compares_the_lock_with_the_best_simple_law_and_holding_still(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = ["--duration-s", "1.5", "--scored-from-s", "0.5"]
    assert demo.main([*times, "--out", str(tmp_path / "demo")]) == 0
    said = capsys.readouterr().out
    assert all(f" {law} " in said for law in demo.LAWS)
    assert " start " in said  # the error before it is scored, beside the others
    assert "start, worst: rms and largest error before 0.5 s" in said
    assert "large" in said  # and what the handles did
    folders = [f"straight-{law}" for law in demo.LAWS]
    for name in ("errors.png", "strip.png", *folders):
        assert (tmp_path / "demo" / name).exists()
    assert (tmp_path / "demo" / folders[-1] / "run.rrd").exists()


def test_options_of_the_demo_replace_its_own() -> None:
    usual = demo.defaults([])
    assert usual[:2] == ["--scenarios", "straight"]
    assert "--scored-from-s" in usual
    rest = ["--scenarios", "straight", "--controllers", *demo.LAWS]
    assert demo.defaults(["--duration-s=3"]) == rest
    changed = demo.defaults(["--controllers", "pi", "--scored_from_s", "10"])
    assert changed == ["--scenarios", "straight", "--duration-s", "50"]


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_holds_and_closes_the_folder(
    how: signal.Signals, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    process = _start_long_run(folder)
    process.send_signal(how)
    assert process.wait(timeout=60) == 130
    record = json.loads((folder / "metrics.json").read_text())
    assert record["interrupted"] is True
    ticks = run_folder.read(folder, "ticks")
    assert ticks["t"][-1].as_py() == pytest.approx(record["duration_s"])
    assert (folder / "run.rrd").exists()


def test_a_killed_run_leaves_a_readable_run_folder(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    process = _start_long_run(folder)
    process.kill()
    process.wait(timeout=60)
    ticks, frames = run_folder.read(folder, "ticks"), run_folder.read(folder, "frames")
    assert ticks["t"].to_pylist() == pytest.approx([0.02 * n for n in range(len(ticks))])
    # with pictures, ticks and frames are handed over together
    assert ticks["t"][-1].as_py() >= frames["t_available"][-1].as_py() - 0.041
    assert log_tables.decode(frames["tip_jpeg"][-1].as_py()).shape == (480, 640, 3)


def _start_long_run(folder: Path) -> subprocess.Popen[str]:
    """Start a run of an hour and wait until its first frames are written."""
    command = [sys.executable, "-m", "endolock.scripts.cli", "run", "straight"]
    process = subprocess.Popen(
        [*command, "--duration-s", "3600", "--out", str(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    frames = folder / "frames.arrows"
    for _ in range(600):
        if frames.exists() and frames.stat().st_size > 200_000:
            return process
        assert process.poll() is None, "the run ended by itself"
        time.sleep(0.1)
    process.kill()
    raise AssertionError("no frames within a minute")


def _endolock(*args: str, env: dict[str, str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "endolock.scripts.cli", *args]
    return subprocess.run(command, capture_output=True, text=True, env=env, check=False)
