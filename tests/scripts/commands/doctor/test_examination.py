"""The doctor: green here, and where something fails a red line that says what to do."""

import json
import os
import platform
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from rich.console import Console

from endolock.hw.api import ConfigError
from endolock.hw.camera import video_camera
from endolock.scripts.commands.doctor import disk_check, examination
from endolock.scripts.commands.doctor.finding import Finding
from endolock.scripts.figures import rerun_export
from endolock.scripts.runs.experiment import Experiment

NAMES = [
    "python",
    "mujoco",
    "numerics",
    "picture",
    "opencv",
    "rerun",
    "disk",
    "serial",
    "video",
    "versions",
]


def test_doctor_passes_on_this_machine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "doctor.json"
    code = examination.main(examination.Request(json=str(target)))
    report, printed = json.loads(target.read_text()), capsys.readouterr().out
    assert [check for check in report["checks"] if not check["ok"]] == []
    assert code == 0
    assert report["ok"] is True
    checks = {check["name"]: check for check in report["checks"]}
    assert list(checks) == NAMES
    assert all(set(check) == {"name", "ok", "text", "advice"} for check in checks.values())
    assert not any(check["advice"] for check in checks.values())
    assert checks["python"]["text"].startswith(f"{platform.python_version()}, ")
    assert checks["mujoco"]["text"].startswith("4.0.")
    assert re.search(r"default \(0\.0\d deg\), fast \(0\.\d\d deg\)", checks["numerics"]["text"])
    assert f"MUJOCO_GL={os.environ.get('MUJOCO_GL', '(unset)')}" in checks["picture"]["text"]
    assert re.search(r"\d+ markers found", checks["opencv"]["text"])
    assert version("rerun-sdk") in checks["rerun"]["text"]
    lines = printed.splitlines()
    assert [line.split()[:2] for line in lines if line[0] != " "] == [[n, "ok"] for n in NAMES]


def test_a_picture_that_cannot_be_drawn_is_a_red_line() -> None:
    """Device 99 exists nowhere, so this EGL cannot draw; the library itself loads."""
    environment = {**os.environ, "MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "99"}
    done = _doctor("doctor.Request()", environment)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    lines = done.stdout.splitlines()
    red = {line.split()[0] for line in lines if line[0] != " " and "FAILS" in line}
    assert red == {"picture", "opencv"}
    assert "MUJOCO_EGL_DEVICE_ID environment variable must be" in " ".join(done.stdout.split())
    assert "-> unset MUJOCO_GL and MUJOCO_EGL_DEVICE_ID, or apt install" in done.stdout


def test_with_json_nothing_else_is_on_standard_output() -> None:
    environment = {**os.environ, "MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "99"}
    done = _doctor("doctor.Request(json='-')", environment)
    assert done.returncode == 2
    report = json.loads(done.stdout)
    assert report["ok"] is False
    assert [check["name"] for check in report["checks"]] == NAMES
    assert {c["name"] for c in report["checks"] if not c["ok"]} == {"picture", "opencv"}
    assert all(bool(check["advice"]) != check["ok"] for check in report["checks"])


def test_mujoco_that_cannot_be_loaded_is_a_red_line() -> None:
    environment = {**os.environ, "MUJOCO_GL": "chalk"}
    done = _doctor("doctor.Request()", environment)
    assert done.returncode == 2
    red = {line.split()[0] for line in done.stdout.splitlines() if "FAILS" in line}
    assert red == {"mujoco", "numerics", "picture", "opencv"}
    assert "invalid value for environment variable MUJOCO_GL: chalk" in " ".join(
        done.stdout.split()
    )


def test_json_that_cannot_be_written_is_refused_first(tmp_path: Path) -> None:
    target = tmp_path / "nowhere" / "doctor.json"
    with pytest.raises(ConfigError, match=r"cannot write .*doctor\.json; give --json a file"):
        examination.main(examination.Request(json=str(target)))


def test_a_version_that_differs_from_the_list_is_reported(tmp_path: Path) -> None:
    listed = tmp_path / "requirements.txt"
    rich = version("rich")
    listed.write_text(
        "# a comment\n"
        "--no-binary nothing\n"
        f"rich=={rich}\n    # via endolock\n"
        "numpy==1.0.0 ; python_version >= '3.11'  # far too old\n"
        "numpy==2.0.0 ; python_version < '3.0'\n"
        "no-such-package==3.1\n"
    )
    finding = examination.versions(listed)
    assert not finding.ok
    numpy = f"numpy {version('numpy')}, listed ==1.0.0"
    assert finding.text == f"{numpy}; no-such-package missing, listed ==3.1"
    assert "--no-deps -r" in finding.advice
    listed.write_text(f"rich=={rich}\nnumpy==2.0.0 ; python_version < '3.0'\n")
    assert examination.versions(listed) == Finding(
        "versions", True, "all 1 as listed in requirements.txt"
    )


def test_without_the_version_list_nothing_is_compared(tmp_path: Path) -> None:
    finding = examination.versions(tmp_path / "requirements.txt")
    assert finding.ok
    assert finding.text == "not a source checkout, nothing to compare"


def test_a_check_that_raises_is_a_red_line(tmp_path: Path) -> None:
    listed = tmp_path / "requirements.txt"
    listed.write_text("this is no requirement\n")
    finding = examination.attempt(
        "versions", lambda: examination.versions(listed), "write it again"
    )
    assert not finding.ok
    assert finding.text.startswith("InvalidRequirement: ")
    assert finding.advice == "write it again"


@pytest.mark.parametrize(("free_gb", "ok"), [(0.0, False), (8.9, False), (9.1, True), (80, True)])
def test_an_hour_of_runs_must_fit(free_gb: float, ok: bool) -> None:
    finding = disk_check.room(int(free_gb * 1e9), Path("/data"), 150.0, "with pictures")
    assert finding.ok is ok  # an hour at 150 MB/min is 9.0 GB
    assert f"{free_gb:.1f} GB free in /data" in finding.text
    assert ("an hour takes 9.0 GB" in finding.advice) is not ok


def test_the_hours_of_runs_are_those_of_a_longer_run(tmp_path: Path) -> None:
    said, kind = disk_check.mb_per_min()
    assert kind == "with pictures"
    folder = tmp_path / "run"
    Experiment(scenario="straight", duration_s=2.4, out=folder).run()
    rerun_export.derive(folder)
    size = sum(file.stat().st_size for file in folder.iterdir())
    true = size / 1e6 * 60 / 2.0  # the first frame comes after 0.4 s
    assert said == pytest.approx(true, rel=0.15)  # pictures differ, and what is written once


def test_video_devices_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    there = ["/dev/video0 (Grabber)", "/dev/video2"]
    monkeypatch.setattr(video_camera, "devices", lambda: there)
    assert examination.video() == Finding("video", True, "/dev/video0 (Grabber), /dev/video2")
    there.clear()
    assert examination.video().text == "none; the twin needs none"


def test_the_table_keeps_every_word_within_80_columns() -> None:
    """Also brackets, which rich would take for markup, and names longer than a line."""
    text = "[Errno 13] permission denied:\n/dev/" + 100 * "x"
    console = Console(width=80, color_system=None)
    with console.capture() as capture:
        console.print(examination.table([Finding("serial", False, text, "join [dialout]")]))
    lines = capture.get().splitlines()
    assert all(len(line) <= 80 for line in lines)
    report = "".join(line[len("serial  FAILS  ") :].strip() for line in lines)
    assert report.count("x") == 100
    assert "[Errno 13] permission denied:" in report
    assert report.endswith("-> join [dialout]")


def _doctor(request: str, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    code = (
        "import sys; from endolock.scripts.commands.doctor import examination as doctor; "
        f"sys.exit(doctor.main({request}))"
    )
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False
    )
