"""Makes the rig and the eyes that the command line names."""

from __future__ import annotations

from endolock.hw.api import ConfigError
from endolock.twin import instruments
from endolock.twin.instrument import NUMERICS, Instrument
from endolock.twin.rig import TwinRig
from endolock.twin.scenario import Scenario
from endolock.vision.markers import MarkerEyes
from endolock.vision.observation import Eyes
from endolock.vision.truth import TruthEyes

RIGS = ("twin",)
VISIONS = ("markers", "truth")


def make(
    rig: str,
    scenario: Scenario,
    *,
    vision: str,
    instrument: str,
    numerics: str = "default",
    seed: int,
    overview: bool = False,
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

    Raises:
        ConfigError: one of the names is unknown, or pictures cannot be rendered here.
    """
    made_of = check(rig, vision, instrument, numerics)
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
    if pictures:
        return twin, MarkerEyes(twin.camera.calibration, twin.board)
    return twin, TruthEyes(twin.truth)


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
            raise ConfigError(f"{what} '{name}' is unknown; use {' or '.join(known)}")
    return instruments.load(instrument)
