"""A handle motor of the twin, as a servo turns it."""

from __future__ import annotations

from collections.abc import Callable

from endolock.hw.api import AXES
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.registers import Units
from endolock.hw.emulator.servo_model import CENTRE, Servo
from endolock.twin.physics.plant import TwinPlant
from endolock.twin.world.instrument import Instrument


class TwinMotor:
    """One rate-limited position motor; see `hw.servo.Motor`.

    Args:
        plant: the handle belongs to it.
        axis: which one.
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
        """Make that the goal."""
        self._plant.data.ctrl[self._motor] = angle_rad

    def power(self, on: bool) -> None:
        """Switch torque; it comes on with the servo's ramp at the present position."""
        if on:
            data = self._plant.data
            data.act[self._setpoint] = data.qpos[self._position]
        # Without torque the geared motor still brakes: of its force kp (goal - q) - kv q', the
        # second part stays. Assumed.
        self._on = on
        kp = self._plant.instrument.handle_kp if on else 0.0
        self._plant.model.actuator_biasprm[self._motor, 1] = -kp


def units(instrument: Instrument) -> Units:
    """Return what the registers of an instrument's servos count in."""
    return Units(
        position_rad=instrument.encoder_step_rad,
        velocity_rad_s=instrument.speed_step_rad_s,
        current_a=instrument.current_step_a,
    )


def servos(plant: TwinPlant, now: Callable[[], float]) -> tuple[Servo, ...]:
    """Put a servo on each handle of a plant.

    Args:
        plant: its handles are turned.
        now: the servos' clock [s].
    """
    counting = units(plant.instrument)
    return tuple(
        Servo(TwinMotor(plant, axis), device=handle.id, now=now, units=counting)
        for axis, handle in handles(plant.instrument).items()
    )


def handles(instrument: Instrument) -> dict[str, Handle]:
    """Return how those servos sit on the handles."""
    reach, speed = instrument.handle_range_rad, instrument.handle_speed_rad_s
    return {
        axis: Handle(id=number, zero_counts=CENTRE, range_rad=(-reach, reach), speed_rad_s=speed)
        for number, axis in enumerate(AXES, 1)
    }
