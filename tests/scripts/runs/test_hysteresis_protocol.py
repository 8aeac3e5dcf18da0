"""The protocol of slow strokes: it needs a tracker, and holds the handles after an interruption."""

import pytest

from endolock.hw.api import ConfigError, Mode
from endolock.scripts.runs.hysteresis_measurement import HysteresisMeasurement
from endolock.scripts.runs.hysteresis_protocol import Protocol
from endolock.twin.rig import TwinRig


def test_a_rig_without_a_tracker_is_refused() -> None:
    with TwinRig("rest", pictures=False) as rig, pytest.raises(ConfigError, match="no pose tracke"):
        Protocol(rig, 0)


def _bend_and_run(protocol: Protocol) -> None:
    protocol.bend_other_axis(0.3)
    protocol.run()


@pytest.mark.parametrize("after_s", [2.0, 6.0])
def test_an_interruption_leaves_the_handles_held(after_s: float) -> None:
    """While the other axis is being bent, and during the strokes."""

    def interrupt(t: float) -> None:
        if t >= after_s:
            raise KeyboardInterrupt

    watched = HysteresisMeasurement().scenario()
    with TwinRig(watched, pictures=False) as rig:
        protocol = Protocol(rig, 0, interrupt)
        with pytest.raises(KeyboardInterrupt):
            _bend_and_run(protocol)
        assert rig.actuators.mode is Mode.HOLDING
