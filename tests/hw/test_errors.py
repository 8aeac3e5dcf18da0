"""Errors are data: what happened, the next step, the calls that resume; sentences at the edge."""

import pickle

import pytest

from endolock.hw import errors
from endolock.hw.errors import (
    RESUME,
    CommandError,
    ConfigError,
    DeviceFault,
    EndolockError,
    HardwareError,
    LinkLost,
    PortBusy,
    StateError,
    add_second,
    for_people,
)

HOT = DeviceFault(
    "motor 2 is hot", "let it cool", kind="overheat", recovery=RESUME, t=1.5, axis="left_right"
)


@pytest.mark.parametrize(
    ("error", "for_programs", "for_users"),
    [
        (ConfigError("seed -1", "use 0 or more"), "seed -1; use 0 or more", None),
        (ConfigError("seed -1"), "seed -1", None),
        (LinkLost("no answer", "check the cable", t=0.0), "no answer; check the cable", None),
        (
            HOT,
            "motor 2 is hot; let it cool, then clear_fault() and enable()",
            "motor 2 is hot; let it cool, then run again",
        ),
        (
            PortBusy("COM3 is in use", "close that program", recovery=("connect",), t=0.0),
            "COM3 is in use; close that program, then connect()",
            "COM3 is in use; close that program, then run again",
        ),
        (
            StateError("cannot move while disabled", recovery=("enable",), t=0.0),
            "cannot move while disabled; call enable() first",
            "cannot move while disabled; run again",
        ),
        (
            StateError("cannot enable: hot", "let it cool", recovery=("clear_fault",), t=0.0),
            "cannot enable: hot; let it cool, then clear_fault()",
            "cannot enable: hot; let it cool, then switch the motors' supply off and on, and run "
            "again",
        ),
    ],
)
def test_programs_are_given_calls_and_people_are_not(
    error: EndolockError, for_programs: str, for_users: str | None
) -> None:
    assert str(error) == for_programs
    assert for_people(error) == (for_users or for_programs)


@pytest.mark.parametrize(
    "error",
    [
        HOT,
        ConfigError("what", "next"),
        CommandError("what", "next", t=1.0, axis="up_down"),
        StateError("what", recovery=("connect",), t=2.0),
    ],
)
def test_they_survive_pickling(error: EndolockError) -> None:
    error.add_note("and more")
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)
    assert "t" in vars(again) or isinstance(again, ConfigError)
    assert again.__notes__[-1] == "and more"


def test_an_error_made_from_an_error_says_the_same() -> None:
    error = ConfigError("what", "next")
    assert str(ConfigError(error)) == str(error) == str(pickle.loads(pickle.dumps(error)))


def test_every_kind_of_error_survives_pickling() -> None:
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type)]
    hardware = [kind for kind in kinds if issubclass(kind, HardwareError)]
    assert len(hardware) == 8
    for kind in hardware:
        more = {"kind": "reset"} if kind is DeviceFault else {}
        error = kind("what", "next", recovery=RESUME, t=3.0, axis="up_down", **more)
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), vars(again)) == (kind, vars(error))


def test_a_second_error_is_a_note_without_calls() -> None:
    first = ConfigError("disk full", "make room")
    add_second(first, "and the handles could not be closed", HOT)
    add_second(first, "and the port could not be closed", KeyError())
    assert for_people(first) == (
        "disk full; make room; and the handles could not be closed: motor 2 is hot; "
        "and the port could not be closed: KeyError"
    )


def test_what_a_terminal_would_obey_is_written_out() -> None:
    error = ConfigError("name 'a\x1b[2J\nb'", "use é")
    assert str(error) == r"name 'a\x1b[2J\nb'; use é"
    assert str(error).isprintable()
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
