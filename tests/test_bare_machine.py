"""The commands of the README on bare machines, and the wheel by itself: 40 minutes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("bare_machine.sh")
CASES = ("root", "root-egl", "sudo", "user")
HALF_AN_HOUR_S = 1800  # a case took under 5 minutes; the rest is for slow networks

pytestmark = [pytest.mark.slow, pytest.mark.bare]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("suite", ["bookworm", "trixie"])
def test_a_fresh_machine_runs_the_demo_and_the_tests(suite: str, case: str) -> None:
    if sys.platform == "win32" or os.geteuid() != 0 or shutil.which("apt-get") is None:
        pytest.fail(
            "a bare machine needs root on Debian or Ubuntu; run this there as root, or run the "
            'other long tests with ./run slow -m "slow and not bare"'
        )
    assert "passed" in _script(suite, case)


@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13", "3.14"])
def test_the_installed_wheel_runs(version: str) -> None:
    models = _script("wheel", _python(version))
    assert "models/endoscope/scene.xml" in models
    assert "models/scenarios/rest.toml" in models


def _script(*arguments: str) -> str:
    """Run the script; print and return its output."""
    # `timeout` ends the script with a signal, and the script removes its files then.
    command = ["timeout", str(HALF_AN_HOUR_S), str(SCRIPT), *arguments]
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8", check=False
    )
    if done.returncode:
        message = f"{' '.join(command)} ended with {done.returncode}:\n{done.stdout}"
        pytest.fail(message, pytrace=False)
    print(done.stdout)
    return done.stdout


def _python(version: str) -> str:
    """Find a Python of a version that can make environments, on the path or from pyenv."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    found = [shutil.which(f"python{version}"), *pyenv.glob(f"versions/{version}.*/bin/python")]
    for python in [str(path) for path in found if path]:
        if subprocess.run([python, "-c", "import ensurepip"], capture_output=True).returncode == 0:
            return python
    pytest.skip(f"there is no Python {version} with ensurepip on this machine")
