"""Capstan law of an elastic cable in a curved conduit, and its lumped form.

Along a conduit of wrap angle Theta (total absolute curvature) and friction coefficient mu, the
tension of a moving wire changes by the capstan law, T_in/T_out = exp(+-S), S = a + b. The exponents
are a = mu Theta of the conduit (`conduit_exponent` in code; mu is `conduit_friction`) and
b = mu_b |bend| of the bending section (`section_exponent`; mu_b is `section_friction`), whose own
elasticity is neglected. With k the stiffness of
the whole cable, pulling it in by x raises the tension at the far end by

    dT = k dx / A on pull,      A = e^b (e^a - 1) / a
    dT = k dx / B on release,   B = e^-b (1 - e^-a) / a

and by nothing in between, until the whole wire slides the other way.

One node that slides with dry friction between two springs has the same slopes, plateau and tension
ratio if the compliances c1 (near the handle), c2 (near the section) and the friction bound F are

    k c1 = (cosh(a+b) - cosh b) / (a sinh(a+b))        k c2 = (cosh a - 1) / (a sinh(a+b))
    F = tanh((a+b)/2) (T_1 + T_2)

because it then slips at T_1/T_2 = e^+-S, where c1 e^+-S + c2 is A/k or B/k. Several nodes in a row
are several such cables in series; they also resolve the tension along the conduit.

Reference:
    M. Kaneko et al., ICRA 1991; G. Palli and C. Melchiorri, ICRA 2006; V. Agrawal, W. J. Peine and
    B. Yao, ICRA 2008. The lumped form is derived here.
"""

from __future__ import annotations

from math import cosh, exp, expm1, sinh, tanh

SMALLEST = 1e-3
"""Smallest a of a lumped cable and smallest k c2 [1]: below it the two springs would become
infinitely stiff and the formulas lose digits. The error of the slopes is at most as large."""


def slip_slopes(conduit_exponent: float, section_exponent: float) -> tuple[float, float]:
    """Travel per tension in units of 1/k, (A, B): while pulling and while releasing.

    Args:
        conduit_exponent: a [1], > 0.
        section_exponent: b [1], >= 0.
    """
    a, b = conduit_exponent, section_exponent
    return exp(b) * expm1(a) / a, exp(-b) * -expm1(-a) / a


def compliances(conduit_exponent: float, section_exponent: float, nodes: int = 1) -> list[float]:
    """Compliances of the springs from handle to section, in units of 1/k.

    Args:
        conduit_exponent: a [1], >= 0.
        section_exponent: b [1], >= 0; it acts behind the last node.
        nodes: number n of friction nodes.

    Returns:
        n + 1 values [1].
    """
    a, b = max(conduit_exponent / nodes, SMALLEST), section_exponent
    cosh_a, denominator = cosh(a), nodes * a * sinh(a + b)
    near = (cosh(a + b) - cosh(b)) / denominator
    far = max((cosh_a - 1) / denominator, SMALLEST / nodes)
    if nodes == 1:
        return [near, far]
    half = (cosh_a - 1) / (nodes * a * sinh(a))  # of a node with b = 0, on either side
    return [half, *[2 * half] * (nodes - 2), half + near, far]


def friction_ratios(
    conduit_exponent: float, section_exponent: float, nodes: int = 1
) -> list[float]:
    """Friction bound of each node over the sum of the tensions on its two sides, tanh(S/2) [1].

    Args:
        conduit_exponent: a [1], >= 0.
        section_exponent: b [1], >= 0; it acts behind the last node.
        nodes: number n of friction nodes.
    """
    a, b = conduit_exponent / nodes, section_exponent
    return [tanh(a / 2)] * (nodes - 1) + [tanh((a + b) / 2)]
