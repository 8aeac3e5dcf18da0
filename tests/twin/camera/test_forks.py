"""Pictures in forked processes: taken before the parent has rendered, refused in a line after."""

import subprocess
import sys

import pytest

SCRIPT = """
import multiprocessing, os, signal, sys, warnings
import mujoco
from endolock.hw.api import ConfigError
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario

warnings.simplefilter("ignore", DeprecationWarning)  # of Python 3.12, about forks beside threads
SMALL = scenario.load("rest", {"camera.width": 64, "camera.height": 48, "camera.latency_s": 0.0})

def take(rig):
    try:
        rig.clock.sleep_until(rig.clock.now() + 0.05)
        return "picture" if rig.camera.latest().image.any() else "black"
    except ConfigError as error:
        return str(error)

def new():
    with TwinRig(SMALL) as rig:
        return take(rig)

def fork(name, work):
    "Work in a child that then exits as a program does, with all that happens at exit."
    sys.stdout.flush()
    if pid := os.fork():
        print(name, "left with", os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
    else:
        signal.alarm(10)  # ends a child that hangs
        print(name, work())
        sys.exit()

def pool(name):
    with multiprocessing.get_context("fork").Pool(1) as workers:
        print(name, workers.apply_async(new).get(10), flush=True)

unused, used, blind = TwinRig(SMALL), TwinRig(SMALL), TwinRig(SMALL, pictures=False)
"""
NO_PARENT_RENDERED = """
fork("new", new)
fork("unused", lambda: take(unused))
pool("pool")
print("parent", new())
"""
PARENT_RENDERED = """
print("parent", take(used))
fork("new", new)
fork("unused", lambda: take(unused))
fork("used", lambda: (take(used), used.close())[0])
fork("blind", lambda: blind.clock.sleep_until(0.1))
fork("child", lambda: fork("grandchild", new))
pool("pool")
print("parent", take(used))
"""
MUJOCO_RENDERED = """
mujoco.Renderer(unused.plant.model, 48, 64).close()
fork("new", new)
print("parent", new())
"""
REFUSED = (
    "pictures cannot be rendered in a process forked from one that has rendered (OpenGL would "
    "hang); use the start method spawn: multiprocessing.get_context('spawn'), or "
    "AsyncVectorEnv(..., context='spawn')"
)


@pytest.mark.parametrize(
    ("code", "lines"),
    [
        (
            NO_PARENT_RENDERED,
            [
                *("new picture", "new left with 0"),
                *("unused picture", "unused left with 0"),
                *("pool picture", "parent picture"),
            ],
        ),
        (
            PARENT_RENDERED,
            [
                "parent picture",
                *(f"new {REFUSED}", "new left with 0"),
                *(f"unused {REFUSED}", "unused left with 0"),
                *(f"used {REFUSED}", "used left with 0"),
                *("blind 0.1", "blind left with 0"),
                *(f"grandchild {REFUSED}", "grandchild left with 0"),
                *("child None", "child left with 0"),
                *(f"pool {REFUSED}", "parent picture"),
            ],
        ),
        (MUJOCO_RENDERED, [f"new {REFUSED}", "new left with 0", "parent picture"]),
    ],
    ids=["no parent rendered", "parent rendered", "mujoco rendered"],
)
def test_a_forked_process_takes_pictures_or_says_how(code: str, lines: list[str]) -> None:
    command = [sys.executable, "-c", SCRIPT + code]
    # 3 s when idle; without the error every child would hang for ever
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.stderr == ""
    assert done.stdout.splitlines() == lines
