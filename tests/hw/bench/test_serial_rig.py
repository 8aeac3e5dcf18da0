"""A bench without a camera: its handles move, and whatever needs a picture says so before."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.hw.served import Served, servo

from endolock.hw.api import Command, ConfigError, Mode
from endolock.hw.bench.bench_file import Bench, BenchCamera, Handles
from endolock.hw.bench.serial_rig import SerialRig
from endolock.hw.dynamixel.handle import Handle
from endolock.scripts.runs import rigs
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument

pytestmark = pytest.mark.wall_time


def bench(folder: Path) -> Bench:
    """Describe two motors, and a camera that is not there."""
    handles = Handles(
        up_down=Handle(id=1, zero_counts=2048), left_right=Handle(id=2, zero_counts=2048)
    )
    return Bench(handle=handles, camera=BenchCamera(source=str(folder / "no-such-device")))


def test_handles_move_without_a_camera(tmp_path: Path) -> None:
    with Served(servo(1), servo(2)) as served, SerialRig(served.path, bench(tmp_path)) as rig:
        rig.actuators.enable()
        start = rig.clock.now()
        while rig.clock.now() < start + 1.0:
            state = rig.actuators.exchange(Command(position=(0.2, -0.1)))
            rig.clock.sleep_until(rig.clock.now() + 0.02)
        assert state.position == pytest.approx((0.2, -0.1), abs=0.01)  # 40 lags: all but a count
        for ask in (rig.camera.latest, lambda: rig.camera.calibration):
            with pytest.raises(ConfigError, match="no-such-device") as caught:
                ask()
            assert "\n" not in str(caught.value)
            assert caught.value.next_step
        assert rig.actuators.mode is Mode.ENABLED  # asking for a picture moves nothing
        assert set(rig.describe()["line"]["motor"]) == {"up_down", "left_right"}


def test_a_run_is_refused_before_the_line_is_opened(tmp_path: Path) -> None:
    with Served(servo(1), servo(2)) as served:
        with pytest.raises(ConfigError, match="no-such-device"):
            rigs.make(
                f"serial:{served.path}",
                scenario.load("rest"),
                vision="markers",
                instrument=Instrument(),
                seed=0,
                bench=bench(tmp_path),
            )
        assert served.bus.asked == set()
