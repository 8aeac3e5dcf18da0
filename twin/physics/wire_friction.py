"""Friction of the wires in their conduits: friction nodes, updated from the state every 10 ms.

MuJoCo has no capstan friction, so each wire is cut: handle - spring - node - spring - section, with
several nodes for loads that matter at the handle. The nodes slide with dry friction; stiffness of
the springs and friction bounds follow from bend and tensions by the law of
`control/transmission/cable.py`: slip slopes, plateau on reversal and T_in/T_out = exp(+-(a+b)) of
an elastic cable in a curved conduit, with a = mu Theta of the shaft and b = mu_b |bend| of the
section.
"""

from __future__ import annotations

from math import hypot, nan

import mujoco

from endolock.control.transmission import cable
from endolock.hw.api import AXES
from endolock.twin.model.wire_springs import LEAST_FRICTION_N
from endolock.twin.world.instrument import WIRES, Instrument

REFRESH_S = 0.010
"""Period of the update [s]. Updating at every step takes 1.4-2 times as long and changes nothing
visible."""
ROW_SOFTNESS = 3e-3
"""Factor on MuJoCo's estimate of the node's inverse inertia: without it, a node under load creeps
by several degrees per minute."""


class WireFriction:
    """Updates the friction nodes of a compiled model from its state.

    It has no state of its own: all that it writes follows from mjData, the bend of the shaft and
    the change of friction.

    Args:
        model: compiled from `section.build`; its stiffness, lengths and friction are rewritten.
        data: the state that it reads.
        instrument: the parameters of the model.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, instrument: Instrument) -> None:
        self._model, self._data, self._instrument = model, data, instrument
        # Springs are in the order of section.py: from handle to section, each for all WIRES.
        wires = len(WIRES)
        first = model.tendon("wire_up_proximal").id
        last = model.tendon(f"wire_{WIRES[-1]}").id + 1
        self._nodes = (last - first) // wires - 1
        # MuJoCo never moves these arrays, so views of them stay valid.
        self._length = data.ten_length[first:last]
        self._stiffness = model.tendon_stiffness[first:last]
        self._rest: list[float] = model.tendon_lengthspring[first:last, 1].tolist()
        self._distal_rest = model.tendon_lengthspring[last - wires : last, 1]
        self._taut = float(self._distal_rest[0]) - instrument.slack_at(0.0)
        node = int(model.joint("slide_up_1").dofadr[0])
        rows = slice(node, node + self._nodes * wires)
        model.dof_invweight0[rows] *= ROW_SOFTNESS
        self._friction = model.dof_frictionloss[rows]
        self._qpos = data.qpos
        hinges = [
            int(model.joint(f"hinge_{axis}_{n}").qposadr[0]) for n, axis in enumerate(AXES, 1)
        ]
        self._up_down, self._left_right = (slice(start, node, len(AXES)) for start in hinges)
        self._shaft_bend_rad = nan

    def refresh(self, shaft_bend_rad: float, friction_times: float = 1.0) -> None:
        """Write stiffness, rest lengths and friction for the present state into the model.

        Args:
            shaft_bend_rad: present bend of the shaft [rad].
            friction_times: present friction of conduits and section over the instrument's [1].
        """
        self.update_lengths()
        if shaft_bend_rad != self._shaft_bend_rad:
            self._bend_shaft(shaft_bend_rad)
        qpos = self._qpos.tolist()
        bend_rad = hypot(sum(qpos[self._up_down]), sum(qpos[self._left_right]))
        exponents = (
            friction_times * self._conduit_exponent,
            friction_times * self._instrument.section_friction * bend_rad,
        )
        k, wires = self._instrument.wire_stiffness, len(WIRES)
        stiffness = [k / c for c in cable.compliances(*exponents, self._nodes) for _ in WIRES]
        self._stiffness[:] = stiffness
        tension = self._tensions(stiffness)
        ratios = cable.friction_ratios(*exponents, self._nodes)
        self._friction[:] = [
            max(ratios[i // wires] * (tension[i] + tension[i + wires]), LEAST_FRICTION_N)
            for i in range(self._nodes * wires)
        ]

    def tensions(self) -> tuple[list[float], list[float]]:
        """Return the tensions [N] at the handle and at the section; lengths must be up to date."""
        tension = self._tensions(self._stiffness.tolist())
        return tension[: len(WIRES)], tension[-len(WIRES) :]

    def update_lengths(self) -> None:
        """Bring positions and lengths up to date; `mj_step` leaves those from before the step."""
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_tendon(self._model, self._data)

    def _bend_shaft(self, shaft_bend_rad: float) -> None:
        """Update what depends on the bend of the shaft alone."""
        instrument = self._instrument
        self._shaft_bend_rad = shaft_bend_rad
        self._conduit_exponent = instrument.conduit_exponent_at(shaft_bend_rad)
        self._distal_rest[:] = self._taut + instrument.slack_at(shaft_bend_rad)
        self._rest[-len(WIRES) :] = self._distal_rest.tolist()

    def _tensions(self, stiffness: list[float]) -> list[float]:
        stretches = zip(stiffness, self._length.tolist(), self._rest, strict=True)
        return [k * (length - rest) if length > rest else 0.0 for k, length, rest in stretches]
