"""Without their packages, the environments say in one line what to install."""

import subprocess
import sys
from importlib.util import find_spec

import pytest


def _last_line(module: str, missing: str) -> str:
    code = f"import sys; sys.modules[{missing!r}] = None; import {module}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    return done.stderr.splitlines()[-1]


def test_without_dm_control() -> None:
    assert _last_line("endolock.twin.env.target_lock", "dm_control") == (
        "endolock.hw.errors.ConfigError: endolock.twin.env.target_lock needs dm-control, which "
        "is not installed; use Python 3.11 or 3.12, where it comes with endolock"
    )


@pytest.mark.skipif(not find_spec("dm_control"), reason="dm-control is missed first")
def test_without_gymnasium() -> None:
    assert _last_line("endolock.twin.env.gym_env", "gymnasium") == (
        "endolock.hw.errors.ConfigError: endolock.twin.env.gym_env needs Gymnasium, which "
        "is not installed; use pip install 'endolock[gym]'"
    )
