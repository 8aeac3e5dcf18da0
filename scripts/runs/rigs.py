"""Registry of rigs and eyes: makes them from their names."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from math import radians
from pathlib import Path
from typing import Any, NamedTuple

from endolock.control.transmission import plays
from endolock.control.transmission.plays import ONE_PLAY, Plays
from endolock.hw.api import ConfigError, Rig
from endolock.hw.bench import bench_file
from endolock.hw.bench.bench_file import Bench
from endolock.hw.bench.serial_rig import SerialRig
from endolock.hw.lifecycle import close_after
from endolock.twin.exact_eyes import eyes_of_truth
from endolock.twin.hil.hil_rig import HilRig
from endolock.twin.physics.foreign_plants import (
    SUM_OF_PLAYS,
    BoucWen,
    CreepAndDrift,
    DeadZone,
    PlayBehindDeadZone,
)
from endolock.twin.physics.surrogate_plant import Transmission, bend_of
from endolock.twin.physics.unequal_wires import UnequalWires
from endolock.twin.rig import TwinRig
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world.fitted_plays import RADII, exercise, plays_of
from endolock.twin.world.instrument import NUMERICS, Instrument, Numerics
from endolock.twin.world.instrument_cable import transmission_of
from endolock.twin.world.scenario import Scenario
from endolock.vision.ego_motion import LEVER_M
from endolock.vision.marker_eyes import MarkerEyes
from endolock.vision.observation import Eyes
from endolock.vision.track_eyes import Selection, TrackEyes

SERIAL = "serial:"
"""Prefix of the name of a bench on a serial port."""
AnyRig = TwinRig | HilRig | SurrogateRig | SerialRig


@dataclass(frozen=True, kw_only=True)
class RigParameters:
    """What a simulated rig is made from; see `make`."""

    scenario: Scenario
    instrument: Instrument
    numerics: Numerics
    seed: int
    pictures: bool
    overview: bool

    @property
    def options(self) -> dict[str, Any]:
        """Arguments that `TwinRig` and `HilRig` share."""
        return {
            "instrument": self.instrument,
            "numerics": self.numerics,
            "seed": self.seed,
            "pictures": self.pictures,
            "overview": self.overview,
        }


class RigKind(NamedTuple):
    """A simulated rig in the registry."""

    make: Callable[[RigParameters], TwinRig | HilRig | SurrogateRig]
    summary: str
    """Description for help texts."""
    pictures: bool = True
    """Whether it renders pictures."""


def _surrogate(parameters: RigParameters, transmission: Transmission | None = None) -> SurrogateRig:
    return SurrogateRig(
        parameters.scenario,
        transmission=transmission,
        instrument=parameters.instrument,
        seed=parameters.seed,
    )


def _wires(parameters: RigParameters) -> SurrogateRig:
    shaft_rad = radians(parameters.scenario.shaft_bend_deg)
    return _surrogate(parameters, transmission_of(parameters.instrument, shaft_rad))


FIXED: dict[str, tuple[Transmission, str]] = {
    "play": (ONE_PLAY, "one play of constant width"),
    "dead_zone": (DeadZone(), "slack without friction"),
    "play_behind_dead_zone": (PlayBehindDeadZone(), "slack, and a play behind it"),
    "bouc_wen": (BoucWen(), "gradual sliding after Bouc and Wen"),
    "creep_and_drift": (CreepAndDrift(), "a play whose bend creeps and drifts"),
    "prandtl_ishlinskii": (SUM_OF_PLAYS, "plays of several widths"),
    "unequal_wires": (UnequalWires(), "two wires with other losses and pulleys"),
}
"""Transmissions that are the same for every instrument, by the name of their rig, and a summary."""
RIGS: dict[str, RigKind] = {
    "twin": RigKind(lambda given: TwinRig(given.scenario, **given.options), "the MuJoCo twin"),
    "hil": RigKind(
        lambda given: HilRig(given.scenario, **given.options),
        "the twin behind an emulated serial line, in lock-step",
    ),
    "hil:wall": RigKind(
        lambda given: HilRig(given.scenario, **given.options, wall=True),
        "the same in wall-clock time",
    ),
    "surrogate": RigKind(_surrogate, "plays fitted to the instrument", pictures=False),
    "quasi_static": RigKind(_wires, "the instrument's wires without inertia", pictures=False),
    **{
        name: RigKind(partial(_surrogate, transmission=made), summary, pictures=False)
        for name, (made, summary) in FIXED.items()
    },
}
"""All simulated rigs by name; a bench is serial:PORT."""
VISIONS = {
    "markers": "find the board in the pictures",
    "track": "follow the target without markers",
    "truth": "exact projections, no pictures, faster",
}
"""All kinds of eyes by name."""


def rig_help() -> str:
    """List all rigs, for the help of a command."""
    without = "; ".join(f"{n} ({kind.summary})" for n, kind in RIGS.items() if not kind.pictures)
    return (
        f"What to drive: {_with_pictures()}; serial:PORT (a bench); or, with --vision truth only, "
        f"a model without physics and pictures: {without}."
    )


def tracked_rig_help() -> str:
    """List the rigs with a pose tracker, those with pictures too, for the help of a command."""
    return f"What to drive: {_with_pictures()}."


def pictured_rig_help() -> str:
    """List the rigs that take pictures, for the help of a command."""
    return f"What to drive: {_with_pictures()}; serial:PORT (a bench)."


def vision_help() -> str:
    """List all kinds of vision, for the help of a command."""
    return _listed(VISIONS)


def picture_vision_help() -> str:
    """List the kinds of vision that look at pictures, for the help of a command."""
    return _listed([name for name in VISIONS if name != "truth"])


def _with_pictures() -> str:
    return "; ".join(f"{n} ({kind.summary})" for n, kind in RIGS.items() if kind.pictures)


def _listed(visions: Iterable[str]) -> str:
    return "; ".join(f"{name}: {VISIONS[name]}" for name in visions) + "."


def make(
    rig: str,
    scenario: Scenario,
    *,
    vision: str,
    instrument: Instrument,
    numerics: str | Numerics = "default",
    seed: int,
    overview: bool = False,
    select: Selection | None = None,
    bench: Bench | None = None,
) -> tuple[AnyRig, Eyes]:
    """Make a rig, with its first picture taken, and the eyes for its frames.

    Args:
        rig: one of `RIGS`, or serial:PORT.
        scenario: the task.
        vision: one of `VISIONS`; truth takes no pictures.
        instrument: parameters of the endoscope.
        numerics: accuracy of the simulation, by its name in `NUMERICS` or as an object.
        seed: seed of all random numbers.
        overview: whether a fixed camera takes pictures too.
        select: rectangle of the first picture to follow, with track only.
        bench: configuration of a serial rig; bench.toml in the current folder, or the defaults,
            if None.

    Raises:
        ConfigError: one of the names is unknown or does not fit the others, pictures cannot be
            rendered here, or the selection is not on the board in the picture.
    """
    check(rig, vision, numerics if isinstance(numerics, str) else "default")
    _check_selection(select, vision)
    made: AnyRig
    if rig.startswith(SERIAL):
        latency_s = scenario.camera.latency_s
        made = SerialRig(rig.removeprefix(SERIAL), bench, latency_s=latency_s)
    else:
        made = RIGS[rig].make(
            RigParameters(
                scenario=scenario,
                instrument=instrument,
                numerics=NUMERICS[numerics] if isinstance(numerics, str) else numerics,
                seed=seed,
                pictures=vision != "truth",
                overview=overview,
            )
        )
    try:
        if rig in RIGS:
            made.clock.sleep_until(0.0)
        lever_m = instrument.bending_length_m / 2 + instrument.rigid_tip_m
        return made, eyes_of(made, vision, scenario, seed, select, lever_m)
    except BaseException as error:
        close_after(error, made.close)
        raise


def eyes_of(
    rig: Rig,
    vision: str,
    scenario: Scenario,
    seed: int,
    select: Selection | None = None,
    lever_m: float = LEVER_M,
) -> Eyes:
    """Make the eyes for a rig; what they shall follow becomes the target of a simulated one.

    Args:
        rig: gives calibration, board and, on a simulated rig, the truth.
        vision: one of `VISIONS`.
        scenario: gives the noise of `TruthEyes`.
        seed: seed of that noise.
        select: rectangle of the first picture to follow, with track only.
        lever_m: distance from the camera to the point about which the section turns it [m].

    Raises:
        ConfigError: the rig has no truth, or the selection is not within the picture, or for
            other eyes.
    """
    if vision not in VISIONS:
        raise ConfigError(f"vision '{vision}' is unknown", f"use {' or '.join(VISIONS)}")
    if vision != "truth" and not getattr(rig, "pictures", True):
        raise ConfigError(f"the rig takes no pictures for {vision}", "use vision truth")
    _check_selection(select, vision)
    calibration = rig.camera.calibration
    if vision == "markers":
        return MarkerEyes(calibration, rig.board, lever_m)
    if vision == "track":
        eyes = TrackEyes(calibration, rig.board, select, lever_m)
        if select and isinstance(rig, TwinRig | HilRig):
            left, top, width, height = select
            rig.aim((left + (width - 1) / 2, top + (height - 1) / 2))
        return eyes
    if rig.truth is None:
        raise ConfigError("the rig has no truth", "use vision markers or track")
    return eyes_of_truth(rig.truth, scenario, seed)


def _check_selection(select: Selection | None, vision: str) -> None:
    if select and vision != "track":
        raise ConfigError(f"select goes with vision track, not with {vision}")


def check(rig: str, vision: str, numerics: str = "default") -> None:
    """Check that all names are known and fit each other.

    Raises:
        ConfigError: they do not.
    """
    serial = rig.startswith(SERIAL) and len(rig) > len(SERIAL)
    for kind, name, known in (
        ("rig", rig, (*RIGS, rig if serial else "serial:PORT")),
        ("vision", vision, tuple(VISIONS)),
        ("numerics", numerics, tuple(NUMERICS)),
    ):
        if name not in known:
            choice = " or ".join(filter(None, (", ".join(known[:-1]), known[-1])))
            raise ConfigError(f"{kind} '{name}' is unknown", f"use {choice}")
    if rig in RIGS and not RIGS[rig].pictures and vision != "truth":
        raise ConfigError(
            f"rig {rig} takes no pictures, which --vision {vision} needs", "use --vision truth"
        )
    if serial and vision == "truth":
        raise ConfigError(f"rig {rig} has no truth", "use --vision markers or track")


def bench_of(rig: str, file: Path | None) -> Bench | None:
    """Read the bench file of a serial rig; None for other rigs.

    Args:
        rig: name of the rig.
        file: see `bench_file.load`.

    Raises:
        ConfigError: it cannot be read, or is given for another rig.
    """
    if rig.startswith(SERIAL):
        bench = bench_file.load(file)
        if not all(handle.zero_counts is not None for handle in bench.handles.values()):
            raise ConfigError(
                f"{file or bench_file.DEFAULT_FILE} lacks zero_counts of one or both handles, so "
                "their ranges would change at every run",
                "straighten the endoscope, then run endolock doctor --port PORT --set-up",
            )
        return bench
    if file is not None:
        raise ConfigError(f"--bench goes with --rig serial:PORT, not with {rig}")
    return None


def plays_behind(rig: str, instrument: Instrument, shaft_deg: float) -> Plays:
    """Return the hysteresis model closest to a rig: the one it simulates, or one fitted to it."""
    if rig not in FIXED:
        return plays_of(instrument, shaft_deg)
    transmission = FIXED[rig][0]
    if isinstance(transmission, Plays):
        return transmission
    handle = exercise()
    return plays.fit(handle, bend_of(transmission, handle), RADII)[0]
