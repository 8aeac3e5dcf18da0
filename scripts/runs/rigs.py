"""Makes the rig and the eyes that the command line names."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from math import radians
from pathlib import Path
from typing import Any

import numpy as np

from endolock.control.transmission import plays, quasi_static
from endolock.control.transmission.plays import ONE_PLAY, Plays
from endolock.control.transmission.quasi_static import Geometry
from endolock.hw.api import ConfigError, Vector
from endolock.hw.bench import bench_file
from endolock.hw.bench.bench_file import Bench
from endolock.hw.bench.serial_rig import SerialRig
from endolock.scripts.checks.strokes import cable_of
from endolock.twin.hil.hil_rig import HilRig
from endolock.twin.randomness import generator
from endolock.twin.rig import TwinRig
from endolock.twin.surrogate import SurrogateRig, Transmission
from endolock.twin.world.instrument import NUMERICS, Instrument
from endolock.twin.world.scenario import Scenario
from endolock.vision.marker_eyes import MarkerEyes
from endolock.vision.observation import Eyes
from endolock.vision.track_eyes import Selection, TrackEyes
from endolock.vision.truth_eyes import TruthEyes

TRANSMISSIONS = ("surrogate", "play", "quasi_static")
"""Kinds of transmission behind a `SurrogateRig`, which takes no pictures."""
RIGS = ("twin", "hil", "hil:wall", *TRANSMISSIONS)
"""And serial:PORT."""
SERIAL = "serial:"
VISIONS = ("markers", "track", "truth")
AnyRig = TwinRig | HilRig | SurrogateRig | SerialRig
RADII = tuple(float(r) for r in np.linspace(0.0, 0.6, 25))
"""Half-widths of plays that are fitted to an instrument [rad]."""


def make(
    rig: str,
    scenario: Scenario,
    *,
    vision: str,
    instrument: Instrument,
    numerics: str = "default",
    seed: int,
    overview: bool = False,
    select: Selection | None = None,
    bench: Bench | None = None,
) -> tuple[AnyRig, Eyes]:
    """Make a rig, with its first picture taken, and what looks at its frames.

    Args:
        rig: kind of rig, one of `RIGS`, or serial:PORT.
        scenario: what happens in front of it.
        vision: kind of eyes, one of `VISIONS`; truth takes no pictures.
        instrument: what the endoscope is made of.
        numerics: how finely it is simulated, one of `NUMERICS`.
        seed: of every random number.
        overview: whether a fixed camera takes pictures too.
        select: rectangle of the first picture to follow, with track only.
        bench: what a serial rig is made of; its file in this folder, or the defaults, if None.

    Raises:
        ConfigError: one of the names is unknown or does not fit the others, pictures cannot be
            rendered here, or the selection is not on the board in the picture.
    """
    check(rig, vision, numerics)
    if select and vision != "track":
        raise ConfigError(f"--select goes with --vision track, not with {vision}")
    if rig.startswith(SERIAL):
        real = SerialRig(rig.removeprefix(SERIAL), bench, latency_s=scenario.camera.latency_s)
        return real, _picture_eyes(real, vision, select)
    if rig in TRANSMISSIONS:
        made = transmission(rig, instrument, scenario.shaft_bend_deg)
        model = SurrogateRig(scenario, transmission=made, instrument=instrument, seed=seed)
        model.clock.sleep_until(0.0)
        return model, exact_eyes(model, scenario, seed)
    options: dict[str, Any] = {
        "instrument": instrument,
        "numerics": NUMERICS[numerics],
        "seed": seed,
        "pictures": vision != "truth",
        "overview": overview,
    }
    twin: TwinRig | HilRig
    if rig == "twin":
        twin = TwinRig(scenario, **options)
    else:
        twin = HilRig(scenario, **options, wall=rig == "hil:wall")
    try:
        twin.clock.sleep_until(0.0)
        if vision == "truth":
            return twin, exact_eyes(twin, scenario, seed)
        eyes = _picture_eyes(twin, vision, select)
        if select:
            left, top, width, height = select
            twin.aim((left + (width - 1) / 2, top + (height - 1) / 2))
    except BaseException:
        twin.close()
        raise
    return twin, eyes


def _picture_eyes(rig: AnyRig, vision: str, select: Selection | None) -> Eyes:
    calibration = rig.camera.calibration
    if vision == "markers":
        return MarkerEyes(calibration, rig.board)
    return TrackEyes(calibration, rig.board, select)


def exact_eyes(rig: TwinRig | HilRig | SurrogateRig, scenario: Scenario, seed: int) -> TruthEyes:
    """Make eyes that need no pictures, with the noise that the scenario wants."""
    noise_px = scenario.camera.truth_noise_px
    return TruthEyes(rig.truth, noise_px, generator(seed, "vision.noise"))


def check(rig: str, vision: str, numerics: str = "default") -> None:
    """See that all names are known and fit each other.

    Raises:
        ConfigError: they do not.
    """
    serial = rig.startswith(SERIAL) and len(rig) > len(SERIAL)
    for what, name, known in (
        ("rig", rig, (*RIGS, rig if serial else "serial:PORT")),
        ("vision", vision, VISIONS),
        ("numerics", numerics, tuple(NUMERICS)),
    ):
        if name not in known:
            choice = " or ".join(filter(None, (", ".join(known[:-1]), known[-1])))
            raise ConfigError(f"{what} '{name}' is unknown", f"use {choice}")
    if rig in TRANSMISSIONS and vision != "truth":
        raise ConfigError(f"rig {rig} takes no pictures for {vision}", "use --vision truth")
    if serial and vision == "truth":
        raise ConfigError(f"rig {rig} knows no truth", "use --vision markers or track")


def bench_of(rig: str, file: Path | None) -> Bench | None:
    """Read what a serial rig is made of; None for other rigs.

    Args:
        rig: kind of rig.
        file: see `hw.bench.load`.

    Raises:
        ConfigError: it cannot be read, or is given for another rig.
    """
    if rig.startswith(SERIAL):
        bench = bench_file.load(file)
        if not all(handle.zero_counts is not None for handle in bench.handles.values()):
            raise ConfigError(
                f"{file or bench_file.DEFAULT_FILE} tells no zero_counts of both handles, so their "
                "ranges would start anew with every run",
                "straighten the endoscope, then run endolock doctor --port PORT --set-up",
            )
        return bench
    if file is not None:
        raise ConfigError(f"--bench goes with --rig serial:PORT, not with {rig}")
    return None


def transmission(rig: str, instrument: Instrument, shaft_deg: float) -> Transmission:
    """Return what lies between handles and bends of a rig without pictures.

    Args:
        rig: one of `TRANSMISSIONS`.
        instrument: what the endoscope is made of; one play of constant width needs none.
        shaft_deg: bend of its shaft [deg].
    """
    if rig == "quasi_static":
        return wires_of(instrument, shaft_deg)
    return plays_behind(rig, instrument, shaft_deg)


def wires_of(instrument: Instrument, shaft_deg: float) -> quasi_static.Transmission:
    """Return the wires of an instrument as the quasi-static solver takes them.

    Args:
        instrument: what the endoscope is made of.
        shaft_deg: bend of its shaft [deg].
    """
    geometry = Geometry(
        bending_length_m=instrument.bending_length_m,
        wire_radius_m=instrument.wire_radius_m,
        pulley_radius_m=instrument.pulley_radius_m,
    )
    cable = cable_of(instrument, radians(shaft_deg))
    return quasi_static.Transmission(cable=cable, geometry=geometry)


def plays_behind(rig: str, instrument: Instrument, shaft_deg: float) -> Plays:
    """Return the hysteresis model that comes nearest to a rig: on a surrogate, its very own."""
    return ONE_PLAY if rig == "play" else plays_of(instrument, shaft_deg)


@lru_cache(maxsize=64)
def plays_of(instrument: Instrument, shaft_deg: float, radii: tuple[float, ...] = RADII) -> Plays:
    """Fit plays to one axis of an instrument, as the quasi-static solver has it.

    Args:
        instrument: what the endoscope is made of.
        shaft_deg: bend of its shaft [deg].
        radii: half-widths to be weighted [rad].
    """
    handle = exercise()
    still = np.zeros(len(handle))
    wires = wires_of(instrument, shaft_deg)
    bend, _ = quasi_static.simulate(wires.cable, wires.geometry, handle, still, still)
    return plays.fit(handle, bend, radii)[0]


def exercise(largest_rad: float = 1.4, step_rad: float = 0.02) -> Vector:
    """Handle angles that go to and fro in strokes of all sizes, from rest [rad]."""
    turns = [0.0]
    for share in (1.0, 0.6, 0.3, 0.1):
        turns += [share * largest_rad, -share * largest_rad, share * largest_rad, 0.0]
    parts = [
        np.linspace(a, b, max(2, round(abs(b - a) / step_rad)), endpoint=False)
        for a, b in pairwise(turns)
    ]
    return np.concatenate(parts)
