"""Parameters of the endoscope, and of the resolution of its simulation."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, pi
from typing import Annotated

from endolock.hw.api import ConfigError
from endolock.hw.strict import bounded
from endolock.hw.strict_fields import settle

WIRES = ("up", "right", "down", "left")
"""The four wires, clockwise as the camera sees them."""
MOST_TENSION_N = 2000.0
"""Largest pretension of a wire [N]: a steel rope of 1.5 mm breaks there. Assumed."""
MOST_EXPONENT = 20.0
"""Largest capstan exponent of the conduit [1]. Assumed: of 1 N, e^-20 is what passes."""
MOST_COUNTS = 30000
"""Largest speed and current in steps of their registers [1]; these have 16 bits."""


@dataclass(frozen=True, kw_only=True)
class Instrument:
    """Bending section, wires, conduit and handles of an endoscope; by default `pretensioned`.

    Sources: *literature* means published data on gastroscopes and colonoscopes in general;
    *assumed* means a plausible value that is not confirmed by any measurement.

    The ranges are those of endoscopes, catheters and continuum robots from 5 mm to 0.5 m, and of
    the motors that move them, some ten times wider: assumed.

    Raises:
        ConfigError: a value is outside the range that its description states.
    """

    bending_length_m: Annotated[float, bounded(0.005, 0.5, "m")] = 0.075
    """From the base to the last ring, along the backbone [m], 0.005 to 0.5. Assumed: somewhat less
    than the 80-100 mm of gastroscopes in the literature."""
    rigid_tip_m: Annotated[float, bounded(0.002, 0.1, "m")] = 0.015
    """From the last ring to the camera [m], 0.002 to 0.1. Assumed."""
    outer_diameter_m: Annotated[float, bounded(0.001, 0.05, "m")] = 0.0098
    """Outer diameter of rings and tip [m], 0.001 to 0.05. Literature: gastroscopes 9-13 mm."""
    wire_radius_m: Annotated[float, bounded(0.0002, 0.025, "m")] = 0.0042
    """Distance of the wire holes from the backbone [m], 0.0002 to 0.025, inside the outer diameter.
    Assumed."""
    bending_stiffness: Annotated[float, bounded(1e-6, 10, "N m/rad")] = 0.05
    """Bending moment over bend of the whole section about one axis [N m/rad], 1e-6 to 10.
    Assumed."""
    damping_time_s: Annotated[
        float, bounded(1e-6, 0.01, "s", hint="a longer one would delay the tip")
    ] = 0.01
    """Joint damping over joint stiffness [s], 1e-6 to 0.01: above, it would delay the tip.
    Assumed."""
    section_mass_kg: Annotated[float, bounded(1e-6, 1, "kg")] = 0.012
    """Mass of all rings together [kg], 1e-6 to 1. Assumed: a solid rod of this size at 2.1
    g/cm3."""
    tip_mass_kg: Annotated[float, bounded(1e-6, 0.5, "kg")] = 0.003
    """Mass of the rigid tip with its camera [kg], 1e-6 to 0.5. Assumed."""
    sheath_friction_nm: Annotated[float, bounded(0, 1, "N m")] = 0.0
    """Dry friction of the sheath against bending, per axis [N m], 0 to 1. Assumed: none."""
    misalignment_rad: Annotated[float, bounded(-pi, pi, "rad")] = 0.0
    """Rotation of the camera about the optical axis relative to the wires, clockwise as seen by the
    camera [rad], -pi to pi. Assumed: none."""

    wire_stiffness: Annotated[float, bounded(1, 5e6, "N/m")] = 4000.0
    """Stiffness of one wire with its conduit, end to end, without friction [N/m], 1 to 5e6.
    Assumed."""
    slack_m: Annotated[float, bounded(-0.05, 0.05, "m")] = -0.00375
    """Free length of each wire at rest, shaft straight [m], -0.05 to 0.05; negative is pretension,
    here 15 N. Assumed."""
    slack_loss_m_per_rad: Annotated[float, bounded(0, 0.02, "m/rad")] = 0.0
    """Free length that each wire loses per bend of the shaft [m/rad], 0 to 0.02. Assumed: none;
    above zero, a slack wire becomes tight as the shaft bends, the two regions of thesis eq.
    3.29."""
    conduit_friction: Annotated[float, bounded(0, 2)] = 0.16
    """Coulomb friction of wire against conduit along the shaft [1], 0 to 2. Assumed, from
    0.1-0.2."""
    section_friction: Annotated[float, bounded(0, 2)] = 0.2
    """Coulomb friction of wire against the rings of the bending section [1], 0 to 2. Assumed."""
    residual_wrap_rad: Annotated[float, bounded(0.001, 20, "rad")] = 1.0
    """Absolute curvature left in a shaft laid out straight [rad], 0.001 to 20. Assumed."""

    pulley_radius_m: Annotated[float, bounded(0.0001, 0.1, "m")] = 0.005
    """Wire travel per handle angle [m/rad], 0.0001 to 0.1. Assumed."""
    handle_range_rad: Annotated[float, bounded(0.01, 2 * pi, "rad")] = 3.141592653589793
    """Largest handle angle in both directions [rad], 0.01 to 2 pi. Assumed."""
    handle_speed_rad_s: Annotated[float, bounded(0.01, 20, "rad/s")] = 3.49
    """Fastest handle motion [rad/s], 0.01 to 20. Assumed: 33 rpm, a small bus servo under load."""
    handle_torque_nm: Annotated[float, bounded(1e-4, 100, "N m")] = 2.0
    """Largest handle motor torque [N m], 1e-4 to 100. Assumed."""
    handle_kp: Annotated[float, bounded(0.01, 1e4, "N m/rad")] = 20.0
    """Servo stiffness [N m/rad], 0.01 to 1e4. Assumed."""
    handle_kv: Annotated[float, bounded(1e-4, 100, "N m s/rad")] = 0.5
    """Servo damping [N m s/rad], 1e-4 to 100; kv/kp = 25 ms is the lag of the handle. Assumed."""
    handle_armature: Annotated[float, bounded(1e-9, 0.1, "kg m2")] = 2e-4
    """Reflected rotor inertia [kg m2], 1e-9 to 0.1. Assumed."""
    torque_constant: Annotated[float, bounded(0.01, 100, "N m/A")] = 1.78
    """Motor torque over current [N m/A], 0.01 to 100, for `State.current`. Data sheet of a
    Dynamixel XM430-W350: stall 4.1 N m at 2.3 A."""
    encoder_step_rad: Annotated[float, bounded(1e-5, 0.1, "rad")] = 0.0015339807878856412
    """Handle position resolution [rad], 1e-5 to 0.1. Data sheet of the same servo: 4096 counts per
    turn."""
    speed_step_rad_s: Annotated[float, bounded(1e-5, 1, "rad/s")] = 0.023980823922402087
    """Handle speed resolution [rad/s], 1e-5 to 1. Data sheet of the same servo: 0.229 rpm."""
    current_step_a: Annotated[float, bounded(1e-5, 1, "A")] = 2.69e-3
    """Motor current resolution [A], 1e-5 to 1. Data sheet of the same servo."""

    def __post_init__(self) -> None:
        settle(self, "instrument")
        if self.wire_radius_m >= self.outer_diameter_m / 2:
            raise ConfigError(
                f"instrument: wire_radius_m {self.wire_radius_m:g} does not fit into an outer "
                f"diameter of {self.outer_diameter_m:g} m",
                "use less than half of it",
            )
        most_a = self.handle_torque_nm / self.torque_constant
        for what, most, step in (
            ("handle_speed_rad_s", self.handle_speed_rad_s, self.speed_step_rad_s),
            ("handle_torque_nm over torque_constant", most_a, self.current_step_a),
        ):
            if most > MOST_COUNTS * step:
                raise ConfigError(
                    f"instrument: {what} {most:g} is more than {MOST_COUNTS} steps of {step:g}",
                    "use a larger step",
                )
        self.check_at(0.0)

    def check_at(self, shaft_bend_rad: float) -> None:
        """Check tension and friction of the wires with the shaft bent.

        Raises:
            ConfigError: a wire would break, or not move.
        """
        at = f"with the shaft at {degrees(shaft_bend_rad):.4g} deg"
        tension = -self.wire_stiffness * self.slack_at(shaft_bend_rad)
        if tension > MOST_TENSION_N:
            raise ConfigError(
                f"instrument: wire_stiffness and slack give a pretension of {tension:.4g} N {at}, "
                f"wanted 0 to {MOST_TENSION_N:g} N",
                "use a lower wire_stiffness, more slack_m or less slack_loss_m_per_rad",
            )
        exponent = self.conduit_exponent_at(shaft_bend_rad)
        if exponent > MOST_EXPONENT:
            raise ConfigError(
                f"instrument: friction over the wrap angle is {exponent:.4g} {at}, wanted 0 to "
                f"{MOST_EXPONENT:g}",
                "use a lower conduit_friction or residual_wrap_rad",
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


_STEP = "use 0.010 s divided by a whole number"


@dataclass(frozen=True, kw_only=True)
class Numerics:
    """Resolution of the simulation in space and time; the defaults are the preset `default`."""

    hinges: Annotated[int, bounded(2, 100)] = 12
    """Number of hinges, alternating up_down and left_right; even, 2 to 100."""
    timestep_s: Annotated[float, bounded(1e-5, 0.01, "s", hint=_STEP)] = 0.002
    """Physics step [s], 10 us to 10 ms; the friction update period of 10 ms must be a multiple of
    it."""
    nodes: Annotated[int, bounded(1, 8)] = 1
    """Friction nodes per wire, 1 to 8. One gives exact tensions at the section; several also
    resolve the tension at the handle."""

    def __post_init__(self) -> None:
        settle(self, "numerics")
        if self.hinges % 2:
            raise ConfigError(f"numerics: {self.hinges} hinges", "use an even number, 2 or more")
        steps = 0.010 / self.timestep_s
        if abs(steps - round(steps)) > 1e-9:
            raise ConfigError(f"numerics: timestep {self.timestep_s:g} s", _STEP)


NUMERICS = {
    "default": Numerics(),
    "fast": Numerics(hinges=10, timestep_s=0.005),
    "fidelity": Numerics(hinges=16, timestep_s=0.001, nodes=3),
}
"""The presets; each can be combined with any instrument."""
