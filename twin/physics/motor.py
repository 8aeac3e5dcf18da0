"""The handle motors of the twin, behind the interface of an emulated servo."""

from __future__ import annotations

from collections.abc import Callable

from endolock.hw.api import AXES
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.registers import Units
from endolock.hw.emulator.servo_model import CENTRE, Servo
from endolock.twin.physics.plant import TwinPlant
from endolock.twin.world.instrument import Instrument


class TwinMotor:
    """One rate-limited position motor; see `hw.emulator.servo_model.Motor`.

    Args:
        plant: the plant of the handle.
        axis: name of the axis.
    """

    def __init__(self, plant: TwinPlant, axis: str) -> None:
        self._plant = plant
        model = plant.model
        joint, motor = model.joint(f"handle_{axis}"), model.actuator(f"motor_{axis}")
        self._position, self._velocity = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._motor, self._setpoint = int(motor.id), int(motor.actadr[0])
        self._on = False

    def measure(self) -> tuple[float, float, float]:
        """Return angle [rad], speed [rad/s] and current [A]."""
        data = self._plant.data
        force = float(data.actuator_force[self._motor]) if self._on else 0.0
        current = force / self._plant.instrument.torque_constant
        return float(data.qpos[self._position]), float(data.qvel[self._velocity]), current

    def aim(self, angle_rad: float) -> None:
        """Set the goal [rad]."""
        self._plant.data.ctrl[self._motor] = angle_rad

    def power(self, on: bool) -> None:
        """Switch the torque; the servo's ramp starts from the present position."""
        if on:
            data = self._plant.data
            data.act[self._setpoint] = data.qpos[self._position]
        # Without torque the geared motor still brakes: of its torque kp (goal - q) - kv q', the
        # second term remains. Assumed.
        self._on = on
        kp = self._plant.instrument.handle_kp if on else 0.0
        self._plant.model.actuator_biasprm[self._motor, 1] = -kp


def units(instrument: Instrument) -> Units:
    """Return the units of the registers of an instrument's servos."""
    return Units(
        position_rad=instrument.encoder_step_rad,
        velocity_rad_s=instrument.speed_step_rad_s,
        current_a=instrument.current_step_a,
    )


def servos(plant: TwinPlant, now: Callable[[], float]) -> tuple[Servo, ...]:
    """Make a servo for each handle of a plant.

    Args:
        plant: the plant whose handles they turn.
        now: the servos' clock [s].
    """
    counting = units(plant.instrument)
    return tuple(
        Servo(TwinMotor(plant, axis), device=handle.id, now=now, units=counting)
        for axis, handle in handles(plant.instrument).items()
    )


def handles(instrument: Instrument) -> dict[str, Handle]:
    """Return how the servos are mounted on the handles."""
    reach, speed = instrument.handle_range_rad, instrument.handle_speed_rad_s
    return {
        axis: Handle(id=number, zero_counts=CENTRE, range_rad=(-reach, reach), speed_rad_s=speed)
        for number, axis in enumerate(AXES, 1)
    }
