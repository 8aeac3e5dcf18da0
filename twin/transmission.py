"""Cable-conduit transmission: one friction node per wire, renewed from the state every 10 ms.

MuJoCo has no capstan friction, so each wire is cut once: handle - spring - node - spring - section.
The node slides with dry friction. With a = mu Theta (shaft), b = mu_b |bend| (section) and k the
stiffness of wire and conduit, the proximal and distal compliances and the friction bound

    c1 = (cosh(a+b) - cosh b) / (a k sinh(a+b))        c2 = (cosh a - 1) / (a k sinh(a+b))
    F  = tanh((a+b)/2) (T_proximal + T_distal)         T  = max(0, (length - rest length) / c)

give the slip slopes on pull and on release, the plateau in between and T_in/T_out = exp(+-(a+b)) of
an elastic cable in a curved conduit with Coulomb friction.

Reference:
    M. Kaneko et al., ICRA 1991; G. Palli and C. Melchiorri, ICRA 2006; V. Agrawal, W. J. Peine and
    B. Yao, ICRA 2008. Lumping them into one node: derived in models/endoscope/README.md.
"""

from __future__ import annotations

from math import cosh, hypot, sinh, tanh

import mujoco
import numpy as np

from endolock.hw.api import AXES
from endolock.twin.instrument import Instrument

WIRES = ("up", "right", "down", "left")
"""The four wires, clockwise as the camera sees them."""
REFRESH_S = 0.010
"""Period of the renewal [s]; every step costs 1.4-2 times more and changes nothing visible."""
ROW_SOFTNESS = 1e-2
"""Factor on MuJoCo's estimate of the node's inverse inertia: without it a node under load creeps
several degrees a minute."""


def spring_stiffness(
    instrument: Instrument, wrap_rad: float, bend_rad: float
) -> tuple[float, float]:
    """Proximal and distal stiffness of one wire [N/m], by the compliances above.

    Args:
        instrument: parameters of wire and conduit.
        wrap_rad: total absolute curvature of the shaft [rad], residual included.
        bend_rad: bend of the section, both axes together [rad], >= 0.
    """
    k = instrument.wire_stiffness
    a = max(instrument.conduit_friction * wrap_rad, 1e-3)
    b = instrument.section_friction * bend_rad
    denominator = a * k * sinh(a + b)
    proximal = (cosh(a + b) - cosh(b)) / denominator
    distal = max((cosh(a) - 1) / denominator, 1e-3 / k)
    return 1 / proximal, 1 / distal


def friction_ratio(instrument: Instrument, wrap_rad: float, bend_rad: float) -> float:
    """Friction bound of a node over the sum of the two tensions, tanh((a+b)/2) [1]."""
    a = instrument.conduit_friction * wrap_rad
    return tanh((a + instrument.section_friction * bend_rad) / 2)


def wrap(instrument: Instrument, shaft_bend_rad: float) -> float:
    """Total absolute curvature of a shaft bent by `shaft_bend_rad` [rad]."""
    return instrument.residual_wrap_rad + abs(shaft_bend_rad)


class Transmission:
    """Keeps the four friction nodes of one compiled model in step with its state.

    It remembers nothing but addresses: whatever it writes follows from mjData and the shaft bend.

    Args:
        model: compiled from `section.build`; its stiffness and friction entries are rewritten.
        instrument: the parameters it was built with.
    """

    def __init__(self, model: mujoco.MjModel, instrument: Instrument) -> None:
        self._model, self._instrument = model, instrument
        # Tendons stand in the order of WIRES, all proximal ones first; see section.py.
        first = model.tendon("wire_up_proximal").id
        self._tendons = slice(first, first + 2 * len(WIRES))
        nodes = [int(model.joint(f"slide_{wire}").dofadr[0]) for wire in WIRES]
        self._nodes = slice(nodes[0], nodes[-1] + 1)
        model.dof_invweight0[self._nodes] *= ROW_SOFTNESS
        self._rest = model.tendon_lengthspring[self._tendons, 1].copy()
        self._bend_from_qpos = np.zeros((model.nq, 2))
        for joint in (model.joint(j) for j in range(model.njnt)):
            for axis, name in enumerate(AXES):
                if joint.name.startswith(f"hinge_{name}"):
                    self._bend_from_qpos[joint.qposadr[0], axis] = 1.0

    def tensions(self, data: mujoco.MjData) -> list[float]:
        """Tensions [N] of the wires at the handle, then at the section; lengths must be current."""
        stretch = np.maximum(data.ten_length[self._tendons] - self._rest, 0.0)
        tensions: list[float] = (self._model.tendon_stiffness[self._tendons] * stretch).tolist()
        return tensions

    def refresh(self, data: mujoco.MjData, shaft_bend_rad: float) -> None:
        """Write stiffness and friction for the present state into the model.

        Args:
            data: its positions are read and its kinematics brought up to date.
            shaft_bend_rad: present bend of the shaft [rad].
        """
        model = self._model
        update_lengths(model, data)
        bend = hypot(*(data.qpos @ self._bend_from_qpos).tolist())
        wrap_rad = wrap(self._instrument, shaft_bend_rad)
        proximal, distal = spring_stiffness(self._instrument, wrap_rad, bend)
        model.tendon_stiffness[self._tendons] = [proximal] * 4 + [distal] * 4
        ratio = friction_ratio(self._instrument, wrap_rad, bend)
        t = self.tensions(data)
        model.dof_frictionloss[self._nodes] = [
            max(ratio * (t[i] + t[i + 4]), 1e-6) for i in range(len(WIRES))
        ]


def update_lengths(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Bring positions and tendon lengths up to date; after a step they are those before it."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_tendon(model, data)


def rest_slide(instrument: Instrument, shaft_bend_rad: float) -> float:
    """Position of every friction node at rest, handles at zero [m]: both springs pull equally."""
    proximal, distal = spring_stiffness(instrument, wrap(instrument, shaft_bend_rad), 0.0)
    return min(0.0, instrument.slack_m) * distal / (proximal + distal)
