"""`endolock doctor`: checks whether everything works here, and says what to do if not.

Every check tries the thing itself: it draws a picture, finds the markers in it, reads a recording
back. What a check needs it imports itself, so a package that cannot be loaded is one red line.
"""

from __future__ import annotations

import os
import platform
import shlex
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.metadata import metadata as metadata_of
from pathlib import Path
from statistics import median
from typing import Annotated

import tyro
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from rich.console import Console
from rich.table import Table
from rich.text import Text

from endolock.hw.api import Calibration, ConfigError, Frame
from endolock.scripts.commands.doctor.disk_check import disk
from endolock.scripts.commands.doctor.finding import Finding
from endolock.scripts.commands.doctor.numerics_check import numerics
from endolock.scripts.runs import output

LISTED = Path(__file__).resolve().parents[3] / "requirements.txt"
"""The version list; it is beside the sources and not installed with them."""
DRAWINGS = 20
OURS = Path(sys.prefix) == LISTED.parent / ".venv"
PIP = "./run pip install" if OURS else f"{shlex.quote(sys.executable)} -m pip install"
"""Command that installs a package in this environment."""
LIST = LISTED.name if OURS else shlex.quote(str(LISTED))
ALL = f"{PIP} --no-deps -r {LIST}" if LISTED.is_file() else "reinstall endolock"
"""Command that installs all packages again."""
OPENGL = (
    "unset MUJOCO_GL and MUJOCO_EGL_DEVICE_ID, or apt install libegl1 libgl1 (Debian and Ubuntu)"
)


@dataclass(frozen=True, kw_only=True)
class Request:
    """Test everything that endolock needs on this machine, and say what to do where it fails."""

    port: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="PORT")] = None
    """Open this serial port too, preferably one in /dev/serial/by-id, and look for motors on it at
    every baud rate; they neither move nor change. Without it no port is opened."""
    set_up: bool = False
    """With --port: set the two motors on it up, and write bench.toml here. They relax and restart;
    what the rows below name gets its usual value, the baud rate becomes 1000000, and the present
    positions their zeros: straighten the endoscope first."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the findings to this file as JSON; - prints only them on standard output."""


Sights = list[tuple[Frame, Calibration]]
"""The picture for the check that looks at it, with the geometry of its camera."""


def main(request: Request) -> int:
    """Carry out `endolock doctor`; return 0 if all checks passed, else 2.

    Raises:
        ConfigError: the JSON or the bench file cannot be written; nothing was checked.
    """
    output.check_json(request.json)
    console = Console(stderr=True)
    if request.set_up:
        from endolock.scripts.commands.doctor import motor_setup

        if request.port is None:
            raise ConfigError("--set-up goes with --port PORT", "name the port of the motors")
        motor_setup.check()
        console.print(motor_setup.WARNING, style="bold", soft_wrap=True, highlight=False)
    findings = examine(console, request)
    ok = all(finding.ok for finding in findings)
    output.write_json({"ok": ok, "checks": [asdict(f) for f in findings]}, request.json)
    if request.json != "-":
        Console().print(table(findings))
    return 0 if ok else 2


def examine(console: Console, request: Request) -> list[Finding]:
    """Carry out all checks in turn; the console shows the present one."""
    sights: Sights = []
    checks: tuple[tuple[str, Callable[[], Finding], str], ...] = (
        ("python", python, "install Python 3.11 or newer"),
        ("mujoco", mujoco_, f"{OPENGL}; or {ALL}"),
        ("numerics", numerics, ALL),
        ("picture", lambda: picture(sights), f"{OPENGL}; until then: --vision truth"),
        ("opencv", lambda: opencv(sights), ALL),
        ("rerun", rerun_, f"{ALL}; make {tempfile.gettempdir()} writable"),
        ("disk", disk, "change to a folder that you may write to"),
        ("serial", serial, "look at ls -l /dev/serial/by-id"),
        ("video", video, ALL),
        ("versions", versions, "get requirements.txt again: git checkout requirements.txt"),
    )
    findings = []
    with console.status("") as status:
        for name, check, advice in checks:
            status.update(f"trying {name}")
            findings.append(attempt(name, check, advice))
        if request.port is not None:
            findings += motors(request.port, request.set_up, lambda n: status.update(f"trying {n}"))
    return findings


def attempt(name: str, check: Callable[[], Finding], advice: str) -> Finding:
    """Carry out one check; an error becomes a finding, with this advice."""
    try:
        return check()
    except ModuleNotFoundError as error:
        return Finding(name, False, str(error), ALL)
    except ConfigError as error:
        return Finding(name, False, error.what, advice)  # what to do depends on the check
    except Exception as error:
        return Finding(name, False, f"{type(error).__name__}: {error}", advice)


def python() -> Finding:
    """Compare this Python with the required version; name the platform."""
    required = SpecifierSet(metadata_of("endolock")["Requires-Python"])
    ok = required.contains(platform.python_version(), prereleases=True)
    text = f"{platform.python_version()}, {platform.platform(terse=True)}"
    return Finding("python", ok, text, "" if ok else f"install Python {required}")


def mujoco_() -> Finding:
    """Load MuJoCo, which loads OpenGL, and compare its version with the required one."""
    import mujoco

    advice = _upgrade("mujoco", mujoco.__version__)
    return Finding("mujoco", not advice, mujoco.__version__, advice)


def picture(sights: Sights) -> Finding:
    """Draw the scene of the twin as its tip camera sees it; append the picture to `sights`."""
    from endolock.twin.camera.renderer import Renderer
    from endolock.twin.model import scene
    from endolock.twin.rig import TwinRig

    with TwinRig("straight", pictures=False) as rig:
        plant, calibration = rig.plant, rig.camera.calibration
        size = calibration.width, calibration.height
        index = scene.camera_id(plant.model, "tip")
        plant.snapshot()  # brings the camera up to date
        plant.draw_board()
        renderer = Renderer(plant.model)
        try:
            image = renderer.draw(plant.data, index, *size).copy()
            from OpenGL import GL as gl

            maker, driver = (
                (gl.glGetString(name) or b"?").decode(errors="replace")
                for name in (gl.GL_VENDOR, gl.GL_RENDERER)
            )
            taken = []
            for _ in range(DRAWINGS):
                start = time.perf_counter()
                renderer.draw(plant.data, index, *size)
                taken.append(time.perf_counter() - start)
        finally:
            renderer.close()
    way = f"MUJOCO_GL={os.environ.get('MUJOCO_GL', '(unset)')}: {maker}, {driver}"
    if image.min() == image.max():
        return Finding(
            "picture", False, f"blank through {way}", f"update the graphics driver; {OPENGL}"
        )
    frame = Frame(image=image, t_capture=0.0, t_available=0.0, seq=0, dropped=0)
    sights.append((frame, calibration))
    speed = f"{1e3 * median(taken):.1f} ms for {size[0]}x{size[1]} px"
    return Finding("picture", True, f"{speed}, {way}")


def opencv(sights: Sights) -> Finding:
    """Compare the version of OpenCV with the required one; find the markers in the picture."""
    import cv2

    advice = _upgrade("opencv-python-headless", cv2.__version__)
    if not sights:
        text = f"{cv2.__version__}, no picture to find markers in"
        return Finding("opencv", False, text, advice or "make the check picture pass first")
    from endolock.hw import boards
    from endolock.vision.marker_eyes import MarkerEyes

    (frame, calibration), geometry = sights[0], boards.standard()
    seen = MarkerEyes(calibration, geometry)(frame)
    found = len(seen.corners_px) // 4
    text = f"{cv2.__version__}, {found} markers found in the picture"
    advice = advice or ("" if seen.status == "tracking" else ALL)
    return Finding("opencv", not advice, text, advice)


def rerun_() -> Finding:
    """Compare the version of Rerun with the required one; write a recording and read it back."""
    import rerun as rr
    import rerun.chunk

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "doctor.rrd"
        with rr.RecordingStream("endolock_doctor") as stream:
            stream.save(path)
            stream.set_time("time", duration=0.5)
            stream.log("error/now", rr.Scalars(1.0))
            stream.disconnect()
        store = rerun.chunk.RrdReader(str(path)).stream().collect()
        entities = {str(entity) for entity in store.schema().entity_paths()}
    got = version("rerun-sdk")
    advice = _upgrade("rerun-sdk", got)
    if "/error/now" not in entities:
        return Finding("rerun", False, f"{got}, a recording came back empty", advice or ALL)
    return Finding("rerun", not advice, f"{got}, a recording written and read back", advice)


def video() -> Finding:
    """List the video devices."""
    from endolock.hw.camera import video_camera  # and with it OpenCV

    return Finding("video", True, ", ".join(video_camera.devices()) or "none; the twin needs none")


def serial() -> Finding:
    """List the serial ports on USB, without opening them."""
    from endolock.scripts.commands.doctor import port_checks

    return port_checks.serial()


def motors(port: str, set_up: bool, report: Callable[[str], None]) -> list[Finding]:
    """Open a serial port and look at the motors on it, or set them up."""
    try:
        from endolock.scripts.commands.doctor import motor_setup, port_checks
    except ModuleNotFoundError as error:
        return [Finding("port", False, str(error), ALL)]
    change = motor_setup.set_up if set_up else None
    return port_checks.examine(port, report, change=change)


def versions(listed: Path = LISTED) -> Finding:
    """Compare what is installed with the version list."""
    if not listed.is_file():
        return Finding("versions", True, "not a source checkout, nothing to compare")
    lines = (line.partition("#")[0].strip() for line in listed.read_text("utf-8").splitlines())
    listed_versions = [Requirement(line) for line in lines if line and not line.startswith("-")]
    here = [r for r in listed_versions if r.marker is None or r.marker.evaluate()]
    wrong = []
    for requirement in here:
        try:
            got = version(requirement.name)
        except PackageNotFoundError:
            got = "missing"
        if got == "missing" or not requirement.specifier.contains(got, prereleases=True):
            wrong.append(f"{requirement.name} {got}, listed {requirement.specifier}")
    if not wrong:
        return Finding("versions", True, f"all {len(here)} as listed in {listed.name}")
    more = f" and {len(wrong) - 5} more" if len(wrong) > 5 else ""
    return Finding("versions", False, f"{'; '.join(wrong[:5])}{more}", ALL)


def table(findings: list[Finding]) -> Table:
    """Lay findings out as a table: name, result, text, and below a failed one what to do."""
    result = Table(box=None, show_header=False, pad_edge=False)
    result.add_column(no_wrap=True)
    result.add_column(no_wrap=True)
    result.add_column(overflow="fold")
    for f in findings:
        word = Text("ok", style="green") if f.ok else Text("FAILS", style="bold red")
        text = Text(" ".join(f.text.split()))  # foreign messages contain brackets and line breaks
        if f.advice:
            text.append(f"\n-> {f.advice}", style="bold")
        result.add_row(f.name, word, text)
    return result


def _upgrade(name: str, got: str) -> str:
    """Return how to install the required version of a package; "" if `got` is one."""
    required = next(r for r in map(Requirement, requires("endolock") or ()) if r.name == name)
    fits = required.specifier.contains(got, prereleases=True)
    return "" if fits else f"{PIP} '{required}'"
