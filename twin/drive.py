"""The twin's handle motors as a guard sees them: goals in, encoder readings out."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from endolock.hw.api import AXES, Clock, Limits
from endolock.hw.guard import Reading
from endolock.twin.plant import TwinPlant


class TwinDrive:
    """Two rate-limited position servos with encoders of finite resolution.

    Args:
        plant: the handles belong to it.
        clock: stamps the readings.
    """

    axes: tuple[str, ...] = AXES

    def __init__(self, plant: TwinPlant, clock: Clock) -> None:
        self.clock = clock
        self._plant = plant
        self._step = plant.instrument.encoder_step_rad
        model = plant.model
        joints = [model.joint(f"handle_{axis}") for axis in AXES]
        motors = [model.actuator(f"motor_{axis}") for axis in AXES]
        self._position = np.array([int(j.qposadr[0]) for j in joints])
        self._velocity = np.array([int(j.dofadr[0]) for j in joints])
        self._motor = np.array([m.id for m in motors])
        self._setpoint = np.array([int(m.actadr[0]) for m in motors])
        self._count_from((0.0, 0.0))
        self._torque_on(False)

    def open(self) -> None:
        """Nothing to do: the twin is always there."""

    def transfer(self, goal: tuple[float, ...] | None) -> Reading:
        """Send a goal [rad], or none, and measure."""
        data = self._plant.data
        if goal is not None:
            data.ctrl[self._motor] = np.add(self.quantise(goal), self._zero)
        position = data.qpos[self._position] - self._zero
        instrument = self._plant.instrument
        powered = data.actuator_force[self._motor] if self._on else np.zeros(len(AXES))
        current = powered / instrument.torque_constant
        t = self.clock.now()
        return Reading(
            t=t,
            t_err=0.0,
            position=_rounded(position, self._step),
            velocity=_rounded(data.qvel[self._velocity], instrument.speed_step_rad_s),
            current=_rounded(current, instrument.current_step_a),
            fresh=True,
            device_tick=round(t * 1000),
        )

    def quantise(self, goal: tuple[float, ...]) -> tuple[float, ...]:
        """Return the nearest encoder position [rad]."""
        return _rounded(goal, self._step)

    def torque(self, on: bool) -> None:
        """Switch torque on or off; it comes on with the servo's ramp at the present position."""
        if on:
            data = self._plant.data
            data.act[self._setpoint] = data.qpos[self._position]
        self._torque_on(on)

    def zero(self) -> None:
        """Make the present position the zero of both axes."""
        x, y = _rounded(self._plant.data.qpos[self._position], self._step)
        self._count_from((x, y))

    def close(self) -> None:
        """Torque off."""
        self._torque_on(False)

    def _count_from(self, zero: tuple[float, float]) -> None:
        """Set the zero, and with it what the handles' stops are counted from."""
        self._zero = zero
        reach = self._plant.instrument.handle_range_rad
        speed = self._plant.instrument.handle_speed_rad_s
        self.limits = Limits(
            position_rad=tuple((-reach - z, reach - z) for z in zero),
            velocity_rad_s=(speed,) * len(self.axes),
        )

    def _torque_on(self, on: bool) -> None:
        # Without torque the geared motor still brakes: of its force kp (goal - q) - kv q', the
        # second part stays. Assumed.
        self._on = on
        kp = self._plant.instrument.handle_kp if on else 0.0
        self._plant.model.actuator_biasprm[self._motor, 1] = -kp


def _rounded(values: Iterable[float], step: float) -> tuple[float, ...]:
    """Return the nearest whole steps."""
    return tuple(round(float(value) / step) * step for value in values)
