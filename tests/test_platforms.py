"""Every module can be imported where there are no terminals, as on macOS and Windows."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LINUX_ONLY = {
    "endolock.hw.dynamixel.linux_port": "any baud rate and exclusive use, by ioctls of Linux",
    "endolock.hw.emulator.pty_line": "a serial line made of a pseudo-terminal",
}
"""Modules that are for Linux alone, and why; others import them only where they are used."""
BY_PYSERIAL = {"endolock.hw.dynamixel.portable_port"}
"""Needs what pyserial needs: terminals where it finds a POSIX system, such as this one."""
OPTIONAL = {
    "endolock.twin.env.gym_env": "gymnasium",
    "endolock.twin.env.target_lock": "dm_control",
}
"""Modules that need a package which may not be installed."""
IMPORT_ALL = """
import importlib, sys
for name in ("fcntl", "termios", "tty", "pty"):
    sys.modules[name] = None
import endolock
for name in sys.argv[1:]:
    importlib.import_module(name)
print("imported")
"""
REFUSED = """
import importlib, sys
sys.modules["serial"] = None
import endolock.twin.hil.hil_server, endolock.hw.dynamixel.port
from endolock.hw.api import ConfigError
sys.platform = sys.argv[1]
def refused(call):
    try:
        call()
    except ConfigError as error:
        print(error)
refused(lambda: importlib.import_module("endolock.hw.emulator.pty_line"))
refused(lambda: endolock.hw.dynamixel.port.serial_port("COM3", 57600))
from endolock.twin.hil.hil_rig import HilRig
refused(lambda: HilRig("rest"))
"""


def test_every_module_can_be_imported_without_terminals() -> None:
    missing = {name for name, package in OPTIONAL.items() if not _installed(package)}
    names = [name for name in _modules() if name not in LINUX_ONLY.keys() | BY_PYSERIAL | missing]
    assert len(names) > 150
    assert _run(IMPORT_ALL, *names) == ["imported"]


@pytest.mark.parametrize("name", LINUX_ONLY)
def test_linux_only_modules_need_terminals(name: str) -> None:
    """Where that is no longer so, the list above is too long."""
    with pytest.raises(subprocess.CalledProcessError):
        _run(IMPORT_ALL, name)


@pytest.mark.parametrize("platform", ["darwin", "win32"])
def test_on_other_systems_linux_features_raise_one_clear_error(platform: str) -> None:
    assert _run(REFUSED, platform) == [
        "the emulated serial line needs Linux; run it there, or use --rig twin",
        "serial ports need pyserial on this system; install it with pip install 'endolock[serial]'",
        "hardware in the loop needs Linux; run it there, or use --rig twin",
    ]


def _modules() -> list[str]:
    """Return the names of all modules of the package."""
    found = ["endolock"]
    for folder in ("control", "hw", "scripts", "twin", "vision"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            if "examples" in file.parts:  # scripts, which run when they are imported
                continue
            parts = file.relative_to(ROOT).with_suffix("").parts
            found.append(".".join(("endolock", *parts)).removesuffix(".__init__"))
    return found


def _installed(package: str) -> bool:
    done = subprocess.run([sys.executable, "-c", f"import {package}"], capture_output=True)
    return done.returncode == 0


def _run(code: str, *args: str) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", code, *args], capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()
