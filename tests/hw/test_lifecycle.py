"""Leaving a rig, a guard or a studio closes it, and never hides the first error."""

import ast
from pathlib import Path
from typing import Any

import pytest

from endolock.hw.bench.serial_rig import SerialRig
from endolock.hw.errors import HardwareError
from endolock.hw.guard import Guard
from endolock.hw.lifecycle import Closing, Connecting, close_all
from endolock.scripts.runs.run_folder import RunFolder
from endolock.twin.camera.stills import Studio
from endolock.twin.hil.hil_rig import HilRig
from endolock.twin.hil.hil_server import HilServer
from endolock.twin.rig import TwinRig
from endolock.twin.surrogate import SurrogateRig

ROOT = Path(__file__).parents[2]
KINDS: list[type[Closing]] = [
    Guard,
    HilRig,
    HilServer,
    RunFolder,
    SerialRig,
    Studio,
    SurrogateRig,
    TwinRig,
]
GONE = HardwareError("cable gone", "plug it in", t=0.0)


class Stuck:
    """Whatever is closed, it fails; connecting fails where that is asked for."""

    def __init__(self, failing: Exception | None = None) -> None:
        self.failing = failing
        self.closed = 0

    def connect(self) -> None:
        """Connect, or fail."""
        if self.failing:
            raise self.failing

    def close(self) -> None:
        """Fail."""
        self.closed += 1
        raise HardwareError("it is stuck", "free it", t=0.0)


def made(kind: type[Closing], stuck: Stuck) -> Any:
    """Return an uninitialised object of that kind that connects and closes like `stuck`."""
    ways = {"connect": lambda _: stuck.connect(), "close": lambda _: stuck.close()}
    return object.__new__(type(kind.__name__, (kind,), ways))


def test_context_exit_is_defined_once() -> None:
    found = {
        (path.name, node.name)
        for folder in ("control", "hw", "scripts", "twin", "vision")
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef) and "__exit__" in _methods(node)
    }
    assert found == {("lifecycle.py", "Closing"), ("api.py", "Actuators")}  # the latter a protocol


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_inside_is_not_hidden(kind: type[Closing]) -> None:
    stuck = Stuck()
    with pytest.raises(ZeroDivisionError) as caught, made(kind, stuck):
        raise ZeroDivisionError
    assert caught.value.__notes__ == ["closing also failed: it is stuck"]
    assert stuck.closed == 1


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_while_closing_alone_is_raised(kind: type[Closing]) -> None:
    with pytest.raises(HardwareError, match=r"^it is stuck; free it$"), made(kind, Stuck()):
        pass


@pytest.mark.parametrize("kind", [kind for kind in KINDS if issubclass(kind, Connecting)])
def test_an_error_while_connecting_is_not_hidden(kind: type[Closing]) -> None:
    stuck = Stuck(GONE)
    with pytest.raises(HardwareError, match="cable gone") as caught, made(kind, stuck):
        raise AssertionError("never entered")
    assert caught.value.__notes__[-1] == "closing also failed: it is stuck"
    assert stuck.closed == 1


def test_all_are_closed_and_the_first_error_is_raised() -> None:
    order: list[int] = []

    def fail(number: int) -> None:
        order.append(number)
        raise HardwareError(f"number {number}", t=0.0)

    calls = [lambda: fail(1), lambda: order.append(2), lambda: fail(3)]
    with pytest.raises(HardwareError, match="number 1") as caught:
        close_all(*calls)
    assert order == [1, 2, 3]
    assert caught.value.__notes__ == ["closing also failed: number 3"]


def test_ctrl_c_while_closing_is_raised_and_the_rest_is_still_closed() -> None:
    order: list[int] = []

    def stop(number: int, error: BaseException) -> None:
        order.append(number)
        raise error

    with pytest.raises(KeyboardInterrupt) as caught:
        close_all(
            lambda: stop(1, GONE), lambda: stop(2, KeyboardInterrupt()), lambda: order.append(3)
        )
    assert order == [1, 2, 3]
    assert caught.value.__notes__ == ["closing also failed: cable gone"]


def test_ctrl_c_while_closing_after_an_error_is_raised() -> None:
    class Stopped(Stuck):
        def close(self) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught, made(SerialRig, Stopped()):
        raise ZeroDivisionError
    assert isinstance(caught.value.__context__, ZeroDivisionError)


def test_a_rig_closes_everything_else_if_its_handles_fail_to_close() -> None:
    rig = TwinRig("rest", pictures=False)
    rig.actuators = stuck = Stuck()  # type: ignore[assignment]
    with pytest.raises(HardwareError, match="it is stuck"):
        rig.close()
    assert stuck.closed == 1
    with pytest.raises(RuntimeError, match="shutdown"):
        rig._darkroom.submit(print)


def _methods(node: ast.ClassDef) -> set[str]:
    return {part.name for part in node.body if isinstance(part, ast.FunctionDef)}
