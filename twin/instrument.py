"""What the endoscope is made of, and how finely it is simulated: two parameter sets."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from endolock.hw.api import ConfigError


@dataclass(frozen=True, kw_only=True)
class Instrument:
    """Bending section, wires, conduit and handle of one endoscope; the defaults are `pretensioned`.

    Sources: *literature* means published data on gastroscopes and colonoscopes in general;
    *assumed* means a plausible value that nothing at hand confirms.

    Raises:
        ConfigError: a value is outside the range that its description states.
    """

    bending_length_m: float = 0.075
    """From the base to the last ring, along the backbone [m], > 0. Assumed, somewhat less than the
    80-100 mm of gastroscopes in the literature."""
    rigid_tip_m: float = 0.015
    """Last ring to the camera [m], > 0. Assumed."""
    outer_diameter_m: float = 0.0098
    """Of rings and tip [m], > 0. Literature: gastroscopes 9-13 mm."""
    wire_radius_m: float = 0.0042
    """Wire holes to the backbone [m], > 0, inside the outer diameter. Assumed."""
    bending_stiffness: float = 0.05
    """Moment per bend of the whole section about one axis [N m/rad], > 0. Assumed."""
    damping_time_s: float = 0.01
    """Joint damping over joint stiffness [s], > 0; not above 10 ms, where it would delay the tip.
    Assumed."""
    section_mass_kg: float = 0.012
    """All rings together [kg], > 0. Assumed: a solid rod of this size at 2.1 g/cm3."""
    tip_mass_kg: float = 0.003
    """Rigid tip with its camera [kg], > 0. Assumed."""

    wire_stiffness: float = 4000.0
    """One wire with its conduit, end to end, without friction [N/m], > 0. Assumed."""
    slack_m: float = -0.00375
    """Free length of each wire at rest [m]; negative is pretension, here 15 N. Assumed."""
    conduit_friction: float = 0.16
    """Wire against conduit along the shaft, Coulomb [1], > 0. Assumed, of 0.1-0.2."""
    section_friction: float = 0.2
    """Wire against the rings of the bending section, Coulomb [1], >= 0. Assumed."""
    residual_wrap_rad: float = 1.0
    """Absolute curvature left in a shaft laid out straight [rad], > 0. Assumed."""

    pulley_radius_m: float = 0.005
    """Wire travel per handle angle [m/rad], > 0. Assumed."""
    handle_range_rad: float = 3.141592653589793
    """Handle angles reach +- this [rad], > 0. Assumed."""
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
    """Handle position resolution [rad], > 0. Data sheet of the same servo: 4096 counts a turn."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isfinite(value):
                raise ConfigError(f"instrument: {name} is {value:g}; use a finite number")
            if value < 0 and name != "slack_m":
                raise ConfigError(f"instrument: {name} is {value:g}; use more than zero")
            if value == 0 and name not in ("slack_m", "section_friction"):
                raise ConfigError(f"instrument: {name} is 0; use more than zero")
        if self.damping_time_s > 0.01:
            raise ConfigError(
                f"instrument: damping_time_s {self.damping_time_s:g} would delay the tip; use at "
                "most 0.01"
            )
        if self.wire_radius_m >= self.outer_diameter_m / 2:
            raise ConfigError(
                f"instrument: wire_radius_m {self.wire_radius_m:g} does not fit into an outer "
                f"diameter of {self.outer_diameter_m:g} m; use less than half of it"
            )

    @property
    def pretension_n(self) -> float:
        """Tension of every wire at rest, handles at zero, without friction [N]."""
        return max(0.0, -self.slack_m * self.wire_stiffness)


@dataclass(frozen=True, kw_only=True)
class Numerics:
    """How finely the section is cut and stepped; the defaults are the preset `default`."""

    hinges: int = 12
    """Hinges in all, alternating up_down and left_right; an even number, 2 or more."""
    timestep_s: float = 0.002
    """Physics step [s]; the friction refresh of 10 ms is a multiple of it."""

    def __post_init__(self) -> None:
        if self.hinges < 2 or self.hinges % 2:
            raise ConfigError(f"numerics: {self.hinges} hinges; use an even number, 2 or more")
        steps = 0.010 / self.timestep_s if self.timestep_s > 0 else 0
        if steps < 1 or abs(steps - round(steps)) > 1e-9:
            raise ConfigError(
                f"numerics: timestep {self.timestep_s:g} s; use 0.010 s divided by a whole number"
            )
