"""Changes during a run: when each begins, what it does, and that nothing else changes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.control.transmission.both_axes import CableTransmission
from endolock.control.transmission.plays import Plays
from endolock.hw.api import Command, ConfigError, Frame
from endolock.scripts.runs import rigs, step_dependence
from endolock.twin.hil.hil_rig import HilRig
from endolock.twin.physics.foreign_plants import BoucWen, CreepAndDrift, PlayBehindDeadZone
from endolock.twin.physics.surrogate_plant import Rubbing, Transmission
from endolock.twin.physics.unequal_wires import UnequalWires
from endolock.twin.rig import TwinRig
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world import mid_run, scenario
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.instrument_cable import transmission_of
from endolock.twin.world.mid_run import Change

LATER = {"start_s": 1.0, "over_s": 0.001}


def frames(seconds: float, seed: int = 0, **values: Any) -> list[Frame]:
    """Return all frames that arrive within a time."""
    made = scenario.load("circle", {"camera.latency_s": 0.1, **values})
    found: list[Frame] = []
    with SurrogateRig(made, seed=seed) as rig:
        for n in range(round(seconds / 0.01)):
            rig.clock.sleep_until(0.01 * n)
            frame = rig.camera.latest()
            if frame and (not found or frame.seq != found[-1].seq):
                found.append(frame)
    return found


def age(frame: Frame) -> float:
    """Return the true latency of a frame [s]."""
    return frame.t_available - frame.seq / 25.0


@given(t=st.floats(0, 20))
def test_a_change_is_a_ramp_from_the_value_before(t: float) -> None:
    changes = mid_run.in_order(
        [
            Change(start_s=10, over_s=2, latency_s=0.2),
            Change(start_s=4, over_s=4, latency_s=0.8, jitter_s=0.1),
        ]
    )
    expected = np.interp(t, [4, 8, 10, 12], [0.4, 0.8, 0.8, 0.2])
    assert mid_run.value_at(changes, "latency_s", 0.4, t) == pytest.approx(expected, abs=1e-12)
    assert mid_run.value_at(changes, "drop_fraction", 0.3, t) == 0.3  # nobody changes it
    assert mid_run.largest(changes, "latency_s", 0.4) == 0.8


@pytest.mark.parametrize("told", [False, True])
def test_the_latency_changes_and_the_camera_may_know(told: bool) -> None:
    belief = {"nominal_latency_s": 0.3} if told else {}
    seen = frames(3.0, change=[{**LATER, "latency_s": 0.3, **belief}])
    before = [f for f in seen if f.seq <= 25]
    after = [f for f in seen if f.seq > 26]  # beyond the ramp of 1 ms
    assert [age(f) for f in before] == pytest.approx([0.1] * len(before))
    assert [age(f) for f in after] == pytest.approx([0.3] * len(after))
    late = [f.t_capture - f.seq / 25.0 for f in after]
    assert late == pytest.approx([0.0 if told else 0.2] * len(after))
    assert [f.t_capture for f in before] == pytest.approx([f.seq / 25.0 for f in before])


def test_drops_and_jitter_begin_when_they_are_said_to() -> None:
    usual = frames(9.0)
    seen = frames(9.0, change=[{**LATER, "drop_fraction": 0.5, "jitter_s": 0.03}])
    assert seen[:24] == usual[:24]
    rest = [f for f in seen if f.seq > 26]
    assert len(rest) == pytest.approx(100, abs=4 * 50**0.5 / 1.4)  # 4 sigma of 200 coins
    off = np.array([age(f) - 0.1 for f in rest])
    assert np.abs(off).max() <= 0.03 + 1e-9
    assert off.std() == pytest.approx(0.03 / 3**0.5, rel=0.3)  # of 100, 7 % by chance


def test_no_frame_arrives_in_a_video_gap_and_the_rest_is_unchanged() -> None:
    usual, gap = frames(4.0), {"start_s": 1.0, "over_s": 1.5}
    seen = frames(4.0, video_gap=[gap])
    kept = [f for f in usual if not 1.0 <= f.t_available < 2.5]
    assert [(f.seq, f.t_capture) for f in seen] == [(f.seq, f.t_capture) for f in kept]
    assert sum(f.dropped for f in seen) == len(usual) - len(kept) > 30


def test_truth_is_kept_for_the_longest_latency() -> None:
    made = scenario.load("circle", {"change": [{**LATER, "latency_s": 3.0}]})
    with SurrogateRig(made) as rig:
        rig.clock.sleep_until(6.0)
        frame = rig.camera.latest()
        assert frame
        assert rig.truth.at_exposure(frame.seq).t == pytest.approx(frame.seq / 25.0, abs=0.01)


WIRES = transmission_of(Instrument(), 3.0)
DOUBLED: list[tuple[Transmission, Transmission]] = [
    (
        Plays(radii=(0.1, 0.3), weights=(0.4, 0.5)),
        Plays(radii=(0.2, 0.6), weights=(0.4, 0.5)),
    ),
    (
        WIRES,
        CableTransmission(
            cable=replace(
                WIRES.cable,
                conduit_exponent=2 * WIRES.cable.conduit_exponent,
                section_friction=2 * WIRES.cable.section_friction,
            ),
            geometry=WIRES.geometry,
        ),
    ),
    (PlayBehindDeadZone(), PlayBehindDeadZone(half_width_rad=2 * 0.18)),
    (BoucWen(), BoucWen(half_width_rad=2 * 0.3)),
    (CreepAndDrift(), CreepAndDrift(half_width_rad=2 * 0.24)),
    (UnequalWires(), UnequalWires(positive_rad=(0.5, 0.9), negative_rad=(0.3, 0.5))),
]


@pytest.mark.parametrize(("usual", "doubled"), DOUBLED)
def test_friction_of_a_surrogate_is_that_of_one_made_with_it(
    usual: Transmission, doubled: Transmission
) -> None:
    axes, other = usual.at_rest(), doubled.at_rest()
    assert isinstance(axes, Rubbing)
    axes.rub(2.0)
    if usual is WIRES:  # its nodes remember where they rest without friction
        for _ in range(2):
            for handle in np.linspace(0, 2 * np.pi, 400):
                pair = 2.0 * np.sin(handle), np.sin(handle)
                bends = axes.follow(pair), other.follow(pair)
        assert bends[0] == pytest.approx(bends[1], abs=2e-3)  # forgets the start but slowly
        return
    for handle in np.linspace(0, 9, 200):
        pair = 1.3 * np.sin(handle), -0.8 * np.sin(handle)
        assert axes.follow(pair) == pytest.approx(other.follow(pair), abs=1e-12)


def bends(rig: TwinRig | HilRig | SurrogateRig, seconds: float = 1.0) -> list[Any]:
    """Turn both handles; return the bends and frames at each control period."""
    with rig:
        rig.actuators.enable()
        seen = []
        for n in range(round(seconds / 0.02)):
            rig.clock.sleep_until(0.02 * n)
            rig.actuators.exchange(Command(position=(0.8 * np.sin(9 * n * 0.02), 0.3)))
            seen.append((rig.truth.now().plant.bend_rad, rig.camera.latest()))
        return seen


CHANGING = {
    "camera.latency_s": 0.06,
    "change": [
        {"start_s": 0.5, "over_s": 0.2, "friction_times": 3.0},
        {"start_s": 0.4, "over_s": 0.1, "latency_s": 0.2, "jitter_s": 0.02, "drop_fraction": 0.3},
    ],
    "video_gap": [{"start_s": 0.2, "over_s": 0.1}],
}


def test_friction_of_the_twin_changes_from_its_start_on_and_repeats_bit_by_bit() -> None:
    usual = [bend for bend, _ in bends(TwinRig("rest", pictures=False))]
    made = scenario.load("rest", CHANGING)
    changed = bends(TwinRig(made, pictures=False))
    assert bends(TwinRig(made, pictures=False)) == changed
    moved = [bend for bend, _ in changed]
    assert moved[:25] == usual[:25]
    # three times the friction holds the tip back by several degrees
    assert np.abs(np.subtract(moved, usual)).max() > 0.05


def test_behind_a_serial_line_it_is_the_same() -> None:
    made = scenario.load("rest", CHANGING)
    far, near = (bends(kind(made, pictures=False)) for kind in (HilRig, TwinRig))
    assert far == near


def test_a_transmission_without_friction_refuses_to_change_it() -> None:
    made = scenario.load("rest", {"change": [{**LATER, "friction_times": 2.0}]})
    with pytest.raises(ConfigError, match=r"scenario rest changes the friction, and this .* none"):
        rigs.make("dead_zone", made, vision="truth", instrument=Instrument(), seed=0)


def test_friction_out_of_range_is_refused_before_the_run() -> None:
    made = scenario.load("rest", {"change": [{**LATER, "friction_times": 10.0}]})
    with pytest.raises(ConfigError, match="section_friction: got 3, wanted 0 to 2"):
        TwinRig(made, instrument=Instrument(section_friction=0.3), pictures=False)


def test_the_check_of_the_step_looks_at_the_changed_friction() -> None:
    made = scenario.load("rest", {"change": [{**LATER, "friction_times": 2.0}]})
    found = step_dependence.error_deg("twin", made, Instrument(), Numerics())
    assert found is not None  # the instrument alone is known to converge
    assert step_dependence.error_deg("twin", made, Instrument(), Numerics()) == found
    rest = scenario.load("rest")
    assert step_dependence.error_deg("twin", rest, Instrument(), Numerics()) is None
    doubled = Instrument(conduit_friction=2 * 0.16, section_friction=2 * 0.2)
    assert found == step_dependence.error_deg("twin", rest, doubled, Numerics())
