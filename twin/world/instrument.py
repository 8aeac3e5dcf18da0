"""Parameters of the endoscope, and of the resolution of its simulation."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi
from typing import Any, ClassVar

from endolock.hw.api import ConfigError

WIRES = ("up", "right", "down", "left")
"""The four wires, clockwise as the camera sees them."""
SIGNED = ("slack_m", "misalignment_rad")
MAY_BE_ZERO = (
    *SIGNED,
    "conduit_friction",
    "section_friction",
    "sheath_friction_nm",
    "slack_loss_m_per_rad",
)
"""Parameters that may be negative (`SIGNED`) or zero; all others are above zero."""


@dataclass(frozen=True, kw_only=True)
class Instrument:
    """Bending section, wires, conduit and handles of an endoscope; by default `pretensioned`.

    Sources: *literature* means published data on gastroscopes and colonoscopes in general;
    *assumed* means a plausible value that is not confirmed by any measurement.

    Raises:
        ConfigError: a value is outside the range that its description states.
    """

    __pydantic_config__: ClassVar[Any] = {"extra": "forbid"}

    bending_length_m: float = 0.075
    """From the base to the last ring, along the backbone [m], > 0. Assumed: somewhat less than the
    80-100 mm of gastroscopes in the literature."""
    rigid_tip_m: float = 0.015
    """From the last ring to the camera [m], > 0. Assumed."""
    outer_diameter_m: float = 0.0098
    """Outer diameter of rings and tip [m], > 0. Literature: gastroscopes 9-13 mm."""
    wire_radius_m: float = 0.0042
    """Distance of the wire holes from the backbone [m], > 0, inside the outer diameter. Assumed."""
    bending_stiffness: float = 0.05
    """Bending moment over bend of the whole section about one axis [N m/rad], > 0. Assumed."""
    damping_time_s: float = 0.01
    """Joint damping over joint stiffness [s], > 0; at most 10 ms, above which it would delay the
    tip. Assumed."""
    section_mass_kg: float = 0.012
    """Mass of all rings together [kg], > 0. Assumed: a solid rod of this size at 2.1 g/cm3."""
    tip_mass_kg: float = 0.003
    """Mass of the rigid tip with its camera [kg], > 0. Assumed."""
    sheath_friction_nm: float = 0.0
    """Dry friction of the sheath against bending, per axis [N m], >= 0. Assumed: none."""
    misalignment_rad: float = 0.0
    """Rotation of the camera about the optical axis relative to the wires, clockwise as seen by the
    camera [rad], within +-pi. Assumed: none."""

    wire_stiffness: float = 4000.0
    """Stiffness of one wire with its conduit, end to end, without friction [N/m], > 0. Assumed."""
    slack_m: float = -0.00375
    """Free length of each wire at rest, shaft straight [m]; negative is pretension, here 15 N.
    Assumed."""
    slack_loss_m_per_rad: float = 0.0
    """Free length that each wire loses per bend of the shaft [m/rad], >= 0. Assumed: none; above
    zero, a slack wire becomes tight as the shaft bends, the two regions of thesis eq. 3.29."""
    conduit_friction: float = 0.16
    """Coulomb friction of wire against conduit along the shaft [1], >= 0. Assumed, from 0.1-0.2."""
    section_friction: float = 0.2
    """Coulomb friction of wire against the rings of the bending section [1], >= 0. Assumed."""
    residual_wrap_rad: float = 1.0
    """Absolute curvature left in a shaft laid out straight [rad], > 0. Assumed."""

    pulley_radius_m: float = 0.005
    """Wire travel per handle angle [m/rad], > 0. Assumed."""
    handle_range_rad: float = 3.141592653589793
    """Largest handle angle in both directions [rad], > 0. Assumed."""
    handle_speed_rad_s: float = 3.49
    """Fastest handle motion [rad/s], > 0. Assumed: 33 rpm, a small bus servo under load."""
    handle_torque_nm: float = 2.0
    """Largest handle motor torque [N m], > 0. Assumed."""
    handle_kp: float = 20.0
    """Servo stiffness [N m/rad], > 0. Assumed."""
    handle_kv: float = 0.5
    """Servo damping [N m s/rad], > 0; kv/kp = 25 ms is the lag of the handle. Assumed."""
    handle_armature: float = 2e-4
    """Reflected rotor inertia [kg m2], > 0. Assumed."""
    torque_constant: float = 1.78
    """Motor torque over current [N m/A], > 0, for `State.current`. Data sheet of a Dynamixel
    XM430-W350: stall 4.1 N m at 2.3 A."""
    encoder_step_rad: float = 0.0015339807878856412
    """Handle position resolution [rad], > 0. Data sheet of the same servo: 4096 counts per turn."""
    speed_step_rad_s: float = 0.023980823922402087
    """Handle speed resolution [rad/s], > 0. Data sheet of the same servo: 0.229 rpm."""
    current_step_a: float = 2.69e-3
    """Motor current resolution [A], > 0. Data sheet of the same servo."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isfinite(value):
                raise ConfigError(f"instrument: {name} is {value:g}", "use a finite number")
            if value < 0 and name in MAY_BE_ZERO and name not in SIGNED:
                raise ConfigError(f"instrument: {name} is {value:g}", "use zero or more")
            if value <= 0 and name not in MAY_BE_ZERO:
                raise ConfigError(f"instrument: {name} is {value:g}", "use more than zero")
        if self.damping_time_s > 0.01:
            raise ConfigError(
                f"instrument: damping_time_s {self.damping_time_s:g} would delay the tip",
                "use at most 0.01",
            )
        if self.wire_radius_m >= self.outer_diameter_m / 2:
            raise ConfigError(
                f"instrument: wire_radius_m {self.wire_radius_m:g} does not fit into an outer "
                f"diameter of {self.outer_diameter_m:g} m",
                "use less than half of it",
            )

        if abs(self.misalignment_rad) > pi:
            raise ConfigError(
                f"instrument: misalignment_rad is {self.misalignment_rad:g}",
                "use -pi to pi, in radians",
            )

    def slack_at(self, shaft_bend_rad: float) -> float:
        """Free length of each wire at rest with the shaft bent [m]; negative is pretension."""
        return self.slack_m - self.slack_loss_m_per_rad * abs(shaft_bend_rad)

    def wrap_at(self, shaft_bend_rad: float) -> float:
        """Total absolute curvature of the bent shaft [rad], the residual included."""
        return self.residual_wrap_rad + abs(shaft_bend_rad)

    def conduit_exponent_at(self, shaft_bend_rad: float) -> float:
        """Capstan exponent mu Theta of the conduit with the shaft bent [1]."""
        return self.conduit_friction * self.wrap_at(shaft_bend_rad)


@dataclass(frozen=True, kw_only=True)
class Numerics:
    """Resolution of the simulation in space and time; the defaults are the preset `default`."""

    hinges: int = 12
    """Number of hinges, alternating up_down and left_right; even, 2 or more."""
    timestep_s: float = 0.002
    """Physics step [s]; the friction update period of 10 ms must be a multiple of it."""
    nodes: int = 1
    """Friction nodes per wire, 1 to 8. One gives exact tensions at the section; several also
    resolve the tension at the handle."""

    def __post_init__(self) -> None:
        if not 1 <= self.nodes <= 8:
            raise ConfigError(f"numerics: {self.nodes} friction nodes per wire", "use 1 to 8")
        if self.hinges < 2 or self.hinges % 2:
            raise ConfigError(f"numerics: {self.hinges} hinges", "use an even number, 2 or more")
        steps = 0.010 / self.timestep_s if self.timestep_s > 0 else 0
        if steps < 1 or abs(steps - round(steps)) > 1e-9:
            raise ConfigError(
                f"numerics: timestep {self.timestep_s:g} s", "use 0.010 s divided by a whole number"
            )


NUMERICS = {
    "default": Numerics(),
    "fast": Numerics(hinges=10, timestep_s=0.005),
    "fidelity": Numerics(hinges=16, timestep_s=0.001, nodes=3),
}
"""The presets; each can be combined with any instrument."""
