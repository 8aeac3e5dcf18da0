"""Ends a simulation that has diverged: its numbers would be finite, and mean nothing.

MuJoCo resets a state that is no longer finite and goes on; and a stiff part that the time step does
not resolve makes the joints jump, with states that are large but finite. So after each piece of
steps, at most 10 ms, this is checked:

    no warning of MuJoCo             it has reset the state, or a matrix was singular
    |speed| step <= 1 rad            per step, hinges and handles
    |hinge| <= 90 deg                rings that are bent further than that would touch
    |handle| <= range + 1 rad        its stops hold it
"""

from __future__ import annotations

from dataclasses import asdict
from math import degrees, inf, pi

import mujoco

from endolock.hw.api import AXES, ConfigError
from endolock.twin.world.instrument import Instrument

LARGEST_TURN_RAD = 1.0
"""Largest motion of a joint within one time step [rad]. Assumed: usual ones are below 0.1."""
LARGEST_HINGE_RAD = pi / 2
LARGEST_OVERRUN_RAD = 1.0
"""Largest angle of a handle beyond its range [rad]. Assumed."""
UNUSUAL = 2.0
"""Factor from its default from which a value is named as unusual [1]."""
NAMED = 3
"""Most values that are named [1]."""


class Stability:
    """Watches the joints of a compiled model.

    Args:
        model: compiled from `section.build`: handles first, then hinges, then nodes.
        data: its state.
        instrument: the parameters of the model.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, instrument: Instrument) -> None:
        self._instrument = instrument
        self._warned = data.warning.number
        self._none = bytes(self._warned.nbytes)
        joints = int(model.jnt_dofadr[model.joint("slide_up_1").id])
        self._handles, self._hinges = data.qpos[: len(AXES)], data.qpos[len(AXES) : joints]
        self._speeds = data.qvel[:joints]
        self._speed = LARGEST_TURN_RAD / float(model.opt.timestep)
        self._reach = instrument.handle_range_rad + LARGEST_OVERRUN_RAD
        if mujoco.get_mju_user_warning() is None:  # else it writes to the terminal, and a file
            mujoco.set_mju_user_warning(_ignore)

    def check(self, t: float) -> None:
        """Check the state.

        Args:
            t: present time [s].

        Raises:
            ConfigError: the simulation has diverged.
        """
        # No part of a sum of squares is above it; what is not a number is within no limit.
        first, second = self._handles.tolist()
        if (
            self._speeds.dot(self._speeds) <= self._speed**2
            and self._hinges.dot(self._hinges) <= LARGEST_HINGE_RAD**2
            and -self._reach <= first <= self._reach
            and -self._reach <= second <= self._reach
            and self._warned.tobytes() == self._none
        ):
            return
        if reason := self._reason():
            raise ConfigError(
                f"the simulation diverged before t = {t:.3f} s: {reason}{self._unusual()}",
                "use values nearer to those of an endoscope, or smaller forces",
            )

    def _reason(self) -> str:
        """Say what is wrong, if anything is."""
        fast, bent, turned = (
            float(abs(part).max()) for part in (self._speeds, self._hinges, self._handles)
        )
        if self._warned.any() or not fast + bent + turned < inf:
            return "MuJoCo reset a state that was not finite"
        if fast > self._speed:
            return f"a joint turns at {fast:.3g} rad/s, which the time step does not resolve"
        if bent > LARGEST_HINGE_RAD:
            return f"a ring is bent by {degrees(bent):.3g} deg to the next one, wanted up to 90 deg"
        if turned > self._reach:
            return f"a handle is at {turned:.3g} rad, beyond its stops"
        return ""

    def _unusual(self) -> str:
        """Name the values of the instrument that are furthest from the default ones."""
        default = asdict(Instrument())
        factors = {
            name: _factor(value, default[name]) for name, value in asdict(self._instrument).items()
        }
        names = sorted((n for n, f in factors.items() if f > UNUSUAL), key=factors.__getitem__)
        listed = [
            f"{name} {getattr(self._instrument, name):g} (default {default[name]:g})"
            for name in reversed(names[-NAMED:])
        ]
        return f"; unusual are instrument.{', '.join(listed)}" if listed else ""


def _factor(value: float, default: float) -> float:
    """How far a value is from its default: their ratio, 1 or more, or as much by difference."""
    if value > 0 and default > 0:
        return max(value / default, default / value)
    return 1 + abs(value - default) / (abs(default) or 1.0)


def _ignore(_warning: str) -> None:
    """Write nothing; `Stability` looks at the counts of the warnings."""
