"""A working folder with a file for every module that Python could find there by mistake."""

import sys
from pathlib import Path

PACKAGES = [
    *("control", "cv2", "endolock", "fastcrc", "matplotlib", "mujoco", "numpy", "OpenGL"),
    *("PIL", "pyarrow", "pydantic", "rerun", "rerun_cli", "rerun_sdk", "rich", "scipy", "tyro"),
]
SPRUNG = "sprung.txt"


def lay(folder: Path) -> None:
    """Write files that note in `SPRUNG` that they were executed, and raise."""
    for name in {*sys.stdlib_module_names, *PACKAGES}:
        text = f"open({str(folder / SPRUNG)!r}, 'a').write({name!r}); raise SystemExit({name!r})\n"
        (folder / f"{name}.py").write_text(text)


def sprung(folder: Path) -> str:
    """Return which of them were executed."""
    note = folder / SPRUNG
    return note.read_text() if note.exists() else ""
