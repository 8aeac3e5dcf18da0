"""Makes the rig and the eyes that the command line names."""

from __future__ import annotations

from endolock.hw.api import ConfigError
from endolock.twin import instruments
from endolock.twin.instrument import NUMERICS, Instrument
from endolock.twin.rig import TwinRig
from endolock.twin.scenario import Scenario
from endolock.vision.markers import MarkerEyes
from endolock.vision.observation import Eyes
from endolock.vision.track import Selection, TrackEyes
from endolock.vision.truth import TruthEyes

RIGS = ("twin",)
VISIONS = ("markers", "track", "truth")


def make(
    rig: str,
    scenario: Scenario,
    *,
    vision: str,
    instrument: str,
    numerics: str = "default",
    seed: int,
    overview: bool = False,
    select: Selection | None = None,
) -> tuple[TwinRig, Eyes]:
    """Make a rig, with its first picture taken, and what looks at its frames.

    Args:
        rig: kind of rig, one of `RIGS`.
        scenario: what happens in front of it.
        vision: kind of eyes, one of `VISIONS`; truth takes no pictures.
        instrument: name of the endoscope, or its TOML file.
        numerics: how finely it is simulated, one of `NUMERICS`.
        seed: of every random number.
        overview: whether a fixed camera takes pictures too.
        select: rectangle of the first picture to follow, with track only.

    Raises:
        ConfigError: one of the names is unknown, pictures cannot be rendered here, or the selection
            is not on the board in the picture.
    """
    made_of = check(rig, vision, instrument, numerics)
    if select and vision != "track":
        raise ConfigError(f"--select goes with --vision track, not with {vision}")
    pictures = vision != "truth"
    twin = TwinRig(
        scenario,
        instrument=made_of,
        numerics=NUMERICS[numerics],
        seed=seed,
        pictures=pictures,
        overview=overview,
    )
    twin.clock.sleep_until(0.0)
    calibration = twin.camera.calibration
    if vision == "truth":
        return twin, TruthEyes(twin.truth)
    if vision == "markers":
        return twin, MarkerEyes(calibration, twin.board)
    eyes = TrackEyes(calibration, twin.board, select)
    if select:
        left, top, width, height = select
        twin.aim((left + (width - 1) / 2, top + (height - 1) / 2))
    return twin, eyes


def check(rig: str, vision: str, instrument: str, numerics: str = "default") -> Instrument:
    """See that all names are known, and read the instrument.

    Raises:
        ConfigError: one is not, or the instrument's file is not good.
    """
    for what, name, known in (
        ("rig", rig, RIGS),
        ("vision", vision, VISIONS),
        ("numerics", numerics, tuple(NUMERICS)),
    ):
        if name not in known:
            choice = " or ".join(filter(None, (", ".join(known[:-1]), known[-1])))
            raise ConfigError(f"{what} '{name}' is unknown; use {choice}")
    return instruments.load(instrument)
