"""Without their packages, the environments say in one line what to install."""

import subprocess
import sys

import pytest

EPISODE = """
from endolock.twin.env import gym_env
made = gym_env.TargetLockEnv("rest")
made.reset(seed=0)
_, reward, *_ = made.step([0.0, 0.0])
print(reward > 0.99)
"""


def _without(packages: tuple[str, ...], code: str) -> subprocess.CompletedProcess[str]:
    hidden = f"import sys; sys.modules.update(dict.fromkeys({packages}))\n"
    return subprocess.run([sys.executable, "-c", hidden + code], capture_output=True, text=True)


def _last_line(module: str, *missing: str) -> str:
    return _without(missing, f"import {module}").stderr.splitlines()[-1]


def test_without_dm_control() -> None:
    assert _last_line("endolock.twin.env.target_lock", "dm_control") == (
        "endolock.hw.errors.ConfigError: endolock.twin.env.target_lock needs dm-control, which "
        "is not installed; use Python 3.11 or 3.12, where it comes with endolock, or "
        "endolock.twin.env.gym_env"
    )


def test_without_gymnasium() -> None:
    assert _last_line("endolock.twin.env.gym_env", "gymnasium", "dm_control", "dm_env") == (
        "endolock.hw.errors.ConfigError: endolock.twin.env.gym_env needs Gymnasium, which "
        "is not installed; use pip install 'endolock[gym]'"
    )


@pytest.mark.extra
def test_gymnasium_needs_no_dm_control() -> None:
    done = _without(("dm_control", "dm_env"), EPISODE)
    assert done.stdout == "True\n", done.stderr
