"""Evidence for how two handles move something measured, under a smooth motion of its own.

What is measured, y (2), follows the handles' two columns of candidate responses z, of which one
each is the true one, and moves by itself:

    y(t) = g_0 z_0,m(t) + g_1 z_1,n(t) + own(t) + noise,

where `own` is integrated white acceleration. A Kalman filter of `own` whitens y and all z alike:
what remains of each is too sudden for `own`, whose motion so far is predicted to go on.
The likelihood of every g_0, g_1 in R^2 then follows from the sums of products of these remainders,
by least squares, for each pair (m, n) and each trial delay of the measurements.

Responses are never exact. Where the best of them leaves more than the noise explains, all evidence
counts less by that ratio, as if the excess came in `EXCESS_DOF` independent pieces.

Reference:
    Whitening by a Kalman filter: P. De Jong, The diffuse Kalman filter, Annals of Statistics 19(2),
    1991. Least squares on the remainders: A. C. Harvey, Forecasting, Structural Time Series Models
    and the Kalman Filter, 1989, ch. 3.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, inf, pi
from typing import NamedTuple

import numpy as np

from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector

SPEED_RAD_S = 0.5
"""Standard deviation of the own speed at first [rad/s]. Assumed."""
MEMORY_S = 20.0
"""Time constant with which evidence is forgotten [s]. Assumed."""
EXCESS_DOF = 5.0
"""Number of independent pieces of what the responses do not explain [1]. Assumed: a misfit lasts
for a whole turn of the handles, of which few happen within `MEMORY_S`."""
TINY = 1e-9
"""Squared distance from a sector within which a response is inside [1]: for rounding."""
PRIOR_WEIGHT = 1.0
"""Weight of a zero response of the other handle [1]. Assumed: next to nothing."""


class Sector(NamedTuple):
    """A set of responses: vectors around a direction."""

    direction_rad: float
    half_rad: float
    """Largest angle from the direction [rad]."""
    least: float
    most: float
    """Least and largest norm [1]."""


class Joint(NamedTuple):
    """Responses of both handles that belong together."""

    own: Sector
    other: tuple[Sector, ...]
    """The other handle's: in one of these sectors."""


class Fit(NamedTuple):
    """The best response of a handle within a sector."""

    log_likelihood: float
    """Relative to no response of either handle, and less where the best one leaves more than noise
    [nat]."""
    response: Pair
    """What the data suggest for the candidates that fit best, also outside the sector [1]."""


class WiringEvidence:
    """Sums from which the likelihood of any response follows.

    Args:
        density: spectral density of the own acceleration [rad2/s3].
        candidates: number of candidate responses of each handle.
        delays: number of trial delays.
    """

    def __init__(self, density: float, candidates: int, delays: int) -> None:
        self._density, self._candidates = density, candidates
        columns = 2 + 2 * candidates
        self._products = np.zeros((delays, columns, columns))
        self.frames = 0.0
        """Number of measurements that count, fewer the older they are."""
        self._t: float | None = None
        self._place = self._speed = np.zeros((delays, columns))
        self._covariance = (0.0, 0.0, 0.0)

    def interrupt(self) -> None:
        """Note that the measurement may have moved by any amount since the last one."""
        self._t = None

    def add(
        self, t: float, measured: Pair, responses: Vector, variance: float, walk: float = 0.0
    ) -> None:
        """Add a measurement; one that is not newer is ignored.

        Args:
            t: time of the measurement [s].
            measured: y on both axes.
            responses: candidates of the first handle, then of the second, for each delay: delays x
                2 candidates.
            variance: of the measurement, each axis.
            walk: variance of the errors that add up since the previous measurement.
        """
        columns = np.empty((len(responses), 2 + responses.shape[1]))
        columns[:, :2], columns[:, 2:] = measured, responses
        if self._t is None:
            self._t, self._place, self._speed = t, columns, np.zeros_like(columns)
            self._covariance = (variance, 0.0, SPEED_RAD_S**2)
            return
        dt = t - self._t
        if dt <= 0:
            return
        self._t = t
        a, b, c = self._covariance
        a += 2 * b * dt + c * dt**2 + self._density * dt**3 / 3 + walk
        b += c * dt + self._density * dt**2 / 2
        c += self._density * dt
        total = a + variance
        gain, slope = a / total, b / total
        self._covariance = (1 - gain) * a, (1 - gain) * b, c - slope * b
        predicted = self._place + dt * self._speed
        off = columns - predicted
        self._place = predicted + gain * off
        self._speed = self._speed + slope * off
        keep = exp(-dt / MEMORY_S)
        self._products *= keep
        self._products += off[:, :, None] * off[:, None, :] / total
        self.frames = keep * self.frames + 1

    def fits(self, handle: int, sectors: Sequence[Sector]) -> list[Fit]:
        """Fit responses of one handle, within sectors; the other handle may respond in any way.

        Args:
            handle: 0 or 1.
            sectors: where the response may be.
        """
        b, response, reached = self._profile(handle)
        discount = self._discount(float(reached.max()))
        norm, angle = _polar(response)
        fits = []
        for sector in sectors:
            inside = reached - b / 2 * _squared_distance(norm, angle, sector)
            best = np.unravel_index(int(np.argmax(inside)), inside.shape)
            up_down, left_right = response[best].tolist()
            fits.append(Fit(float(inside[best]) * discount, (up_down, left_right)))
        return fits

    def against(self, handle: int, sector: Sector, joints: Sequence[Joint]) -> Fit:
        """Fit responses of both handles that belong together, and compare them with a sector.

        What is counted is only what a handle explains beyond the other one, whose response has to
        belong to it: it is as likely as the other one is, after this one's, in its sectors. In
        the sector compared with, the other handle may respond in any way.

        Args:
            handle: 0 or 1.
            sector: where the response of that handle may be instead.
            joints: where both may be.

        Returns:
            The best of the joints, with its log-likelihood relative to that of the sector.
        """
        b, response, reached = self._profile(handle)
        norm, angle = _polar(response)
        instead = float((reached - b / 2 * _squared_distance(norm, angle, sector)).max())
        n = self._candidates
        own, other = slice(handle * n, (handle + 1) * n), slice((1 - handle) * n, (2 - handle) * n)
        y, z = self._products[:, 2:, :2], self._products[:, 2:, 2:]
        curvature = np.diagonal(z[:, other, other], axis1=1, axis2=2)[:, None, :] + PRIOR_WEIGHT
        left = y[:, None, other, :] - z[:, own, other, None] * response
        other_norm, other_angle = _polar(left / curvature[..., None])
        best = Fit(-inf, (0.0, 0.0))
        for joint in joints:
            apart = np.min(
                [_squared_distance(other_norm, other_angle, place) for place in joint.other], axis=0
            )
            inside = np.where(
                _squared_distance(norm, angle, joint.own) < TINY,
                reached - curvature / 2 * apart,
                -inf,
            )
            at = np.unravel_index(int(np.argmax(inside)), inside.shape)
            gained = float(inside[at])
            if gained > -inf:
                ratio = (gained - instead) * self._discount(gained)
                up_down, left_right = response[at].tolist()
                best = max(best, Fit(ratio, (up_down, left_right)))
        return best

    def _discount(self, reached: float) -> float:
        """Weight of evidence whose best response reaches a log-likelihood."""
        spread = float(self._products[0, 0, 0] + self._products[0, 1, 1])
        return 1 / (1 + max(0.0, spread - 2 * reached - 2 * self.frames) / EXCESS_DOF)

    def _profile(self, handle: int) -> tuple[Vector, Vector, Vector]:
        """Curvature, best response and its log-likelihood: delays x own x other candidates."""
        n = self._candidates
        y, z = self._products[:, 2:, :2], self._products[:, 2:, 2:]
        own, other = slice(handle * n, (handle + 1) * n), slice((1 - handle) * n, (2 - handle) * n)
        own_own = np.diagonal(z[:, own, own], axis1=1, axis2=2)[:, :, None]
        other_other = np.diagonal(z[:, other, other], axis1=1, axis2=2)[:, None, :] + PRIOR_WEIGHT
        share = z[:, own, other] / other_other
        b = own_own - share * z[:, own, other] + 1e-9  # least curvature: nothing was seen
        a = y[:, own, None, :] - share[..., None] * y[:, None, other, :]
        reached = (y[:, other] ** 2).sum(-1)[:, None, :] / (2 * other_other) + (a**2).sum(-1) / (
            2 * b
        )
        return b, a / b[..., None], reached


def _polar(response: Vector) -> tuple[Vector, Vector]:
    """Norm and angle of responses."""
    first, second = response[..., 0], response[..., 1]
    return np.hypot(first, second), np.arctan2(second, first)


def _squared_distance(norm: Vector, angle: Vector, sector: Sector) -> Vector:
    """Squared distance of points, given by norm and angle, to a sector."""
    apart = np.abs((angle - sector.direction_rad + pi) % (2 * pi) - pi)
    across = norm * np.cos(np.maximum(apart - sector.half_rad, 0.0))
    along = np.clip(across, sector.least, sector.most)
    return np.asarray(norm**2 - 2 * along * across + along**2)
