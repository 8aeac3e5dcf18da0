"""Finds handles that turn the tip the wrong way, or about the other axis, from their first motion.

Two measurements tell how the handles turn the tip: the bend from the background, and the offset of
the target from the axis, which moves against the tip. For each, the likelihood of every response of
the handles is known (control/predictive/wiring_evidence.py): plays of unknown width or a dead zone,
for a video delay that is known to 30 %. The best *right* response of a handle, near its own axis or
none at all, is compared with the best *wrong* one. Within its dead band a handle moves while the
target moves and the tip does not, as if it turned the tip away from the target. But such a target
moved before the handle did; a tip that runs away moves with the handle, all of a sudden.

A handle is accused only by what its motion explains beyond what the other one's explains, and only
together with it: a handle that turns the tip the wrong way leaves the other one on its own axis;
one that turns it about the other axis has been exchanged with the other handle, which then turns
the tip about its axis, and is not clearly right. What the data suggest has to be wrong, of the
size of a response that exists, and for some frames in a row. Else a handle that wanders in step
with the other one, within its dead band, would explain what no play explains of the other's.

A handle that is clearly right is not checked again. A camera that is rotated by 90 or 180 deg looks
like exchanged or reversed handles, and one rotated by less than 45 deg like right ones.
"""

from __future__ import annotations

from bisect import bisect
from collections import deque
from math import atan2, degrees, pi

import numpy as np

from endolock.control.predictive.wiring_evidence import Joint, Sector, WiringEvidence
from endolock.control.transmission import kinematics
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.hw.api import AXES, Vector
from endolock.hw.errors import WiringError

RADII = (0.0, 0.05, 0.1, 0.16, 0.22, 0.3, 0.4, 0.55)
"""Half-widths of the plays behind a handle [rad]. Assumed: up to a loop of a third of a turn."""
DEAD_ZONES = (0.1, 0.25, 0.4)
"""Halves of dead zones behind a handle [rad]. Assumed."""
DELAYS_S = (-0.12, 0.0, 0.12)
"""Trial delays of the exposures relative to their believed times [s]: 30 % of 0.4 s."""
RIGHT_RAD, WRONG_RAD = 0.8, 1.1
"""Angle from its own axis up to which the response of a handle is right, and above which it is
wrong [rad]. Assumed: on either side of 1, 30 deg from the exact directions of both."""
LEAST, MOST = 0.4, 1.7
"""Norm of a response that exists [rad/rad]. Assumed: half the usual one to almost twice."""
ALARM, SURE = 7.0, 8.0
"""Log-likelihood ratio above which a handle is wrong, and above which it is right [nat]. Assumed:
in 121 runs with right handles, on plants of ten kinds, the largest ratio was 2."""
TIMES = 3
"""Number of frames in a row that have to accuse a handle [1]. Assumed: one or two may be off."""
SWING_RAD = 0.25
"""Range of a handle below which it is not judged [rad]. Assumed: the tip has to move 0.1 rad."""
TARGET_DENSITY, PUSH_DENSITY = 0.1, 0.02
"""Spectral density of the acceleration of targets, and of a tip that is pushed [rad2/s3].
Assumed."""
TARGET_STD_RAD, BEND_STD_RAD = 0.003, 0.001
"""Least standard deviation of an offset, and of a sum of turns [rad]. Assumed."""
LATE_S = 0.02
"""Standard deviation of a single exposure time [s]. Assumed: half a frame."""
JUDGE_FRAMES = 3
"""Frames from one judgement to the next, of the other handle [1]. Assumed."""
RATE_TICKS = 5
"""Number of control periods over which the speed of the handles is measured. Assumed."""
KEEP_S = 2.0
"""Time for which responses are kept [s]: longer than any latency in use."""


class WiringCheck:
    """Watches the handles' first motions.

    Args:
        geometry: lengths of the section.
    """

    def __init__(self, geometry: SectionGeometry) -> None:
        self._geometry = geometry
        self._base_from_camera = kinematics.forward(geometry, (0.0, 0.0))[1]
        self._past: deque[tuple[float, list[float], float]] = deque()  # time, responses, travel
        self._handles: Pair | None = None
        self._lowest = self._highest = (0.0, 0.0)
        self._travel = 0.0
        self._bend = (0.0, 0.0)
        candidates = len(RADII) + len(DEAD_ZONES)
        self._target, self._turn = (
            WiringEvidence(density, candidates, len(DELAYS_S))
            for density in (TARGET_DENSITY, PUSH_DENSITY)
        )
        self._frames = 0
        self._suspected = [0, 0]  # frames in a row
        self.open = [True, True]
        """Whether a handle is still being checked."""

    def follow(self, t: float, handles: Pair) -> None:
        """Take the measured handle angles [rad] of one control period."""
        if not any(self.open) or (self._past and t <= self._past[-1][0]):
            return
        if self._handles is None:
            self._handles = self._lowest = self._highest = handles
        count = len(RADII) + len(DEAD_ZONES)
        before = self._past[-1][1] if self._past else [h for h in handles for _ in range(count)]
        responses = []
        for n, h in enumerate(handles):
            plays = zip(before[n * count :], RADII, strict=False)
            responses += [min(max(z, h - r), h + r) for z, r in plays]
            responses += [h - min(max(h, -s), s) for s in DEAD_ZONES]
        self._travel += sum(abs(a - b) for a, b in zip(handles, self._handles, strict=True))
        self._handles = handles
        (a, b), (low_a, low_b), (high_a, high_b) = handles, self._lowest, self._highest
        self._lowest, self._highest = (
            (min(a, low_a), min(b, low_b)),
            (max(a, high_a), max(b, high_b)),
        )
        self._past.append((t, responses, self._travel))
        while self._past[0][0] < t - KEEP_S:
            self._past.popleft()

    def look(
        self, exposed_s: float, target: Vector | None, turned: Pair | None, variances: Pair
    ) -> None:
        """Take what one frame shows, and judge the handles in turn.

        Args:
            exposed_s: believed time of exposure [s].
            target: the target in camera axes [m]; None if it was not found.
            turned: change of the bend since the previous frame, by the background [rad]; None if
                it was not measured.
            variances: of the target's direction, and of `turned` [rad2].

        Raises:
            WiringError: a handle turns the tip the wrong way, or about the other axis.
        """
        if not any(self.open) or len(self._past) <= RATE_TICKS:
            return
        responses, rate = self._responses(exposed_s)
        late = (LATE_S * rate) ** 2
        if target is not None:
            up_down, left_right = kinematics.aim(self._geometry, self._base_from_camera @ target)
            variance = variances[0] + TARGET_STD_RAD**2 + late
            self._target.add(exposed_s, (-up_down, -left_right), responses, variance)
        if turned is None:
            self._turn.interrupt()
        else:
            self._bend = self._bend[0] + turned[0], self._bend[1] + turned[1]
            variance = BEND_STD_RAD**2 + late
            self._turn.add(exposed_s, self._bend, responses, variance, variances[1])
        self._frames += 1
        suspects = [n for n in (0, 1) if self._suspected[n]]
        handle = suspects[0] if suspects else self._frames // JUDGE_FRAMES % 2
        if self._frames % JUDGE_FRAMES and not suspects:
            return
        if self.open[handle] and self._highest[handle] - self._lowest[handle] > SWING_RAD:
            # The target moves by itself: it is a witness only where there is no better one.
            seen = 2 * self._turn.frames > self._target.frames
            self._judge(handle, self._turn if seen else self._target)

    def _responses(self, exposed_s: float) -> tuple[Vector, float]:
        """Responses at an exposure, for each trial delay, and the speed of the handles [rad/s]."""
        last = len(self._past) - 1
        earlier, later, shares = [], [], []
        for delay in DELAYS_S:
            n = min(max(bisect(self._past, exposed_s + delay, key=_time), 1), last)
            (before, a, _), (after, b, _) = self._past[n - 1], self._past[n]
            earlier.append(a)
            later.append(b)
            shares.append(min(max((exposed_s + delay - before) / (after - before), 0.0), 1.0))
        first, second = np.array([earlier, later])
        rows = first + np.array(shares)[:, None] * (second - first)
        n = min(max(bisect(self._past, exposed_s, key=_time), RATE_TICKS), last)
        (began, _, travel), (ended, _, travelled) = self._past[n - RATE_TICKS], self._past[n]
        return rows, (travelled - travel) / (ended - began)

    def _judge(self, handle: int, evidence: WiringEvidence) -> None:
        own = (0.0, pi / 2)[handle]
        right, wrong, clear, none = evidence.fits(
            handle,
            (
                Sector(own, RIGHT_RAD, 0.0, MOST),
                Sector(own + pi, pi - WRONG_RAD, LEAST, MOST),
                Sector(own, RIGHT_RAD, LEAST, MOST),
                Sector(own, 0.0, 0.0, 0.0),
            ),
        )
        if wrong.log_likelihood - right.log_likelihood > ALARM:
            self._suspect(handle, evidence)
        else:
            self._suspected[handle] = 0
        unclear = max(wrong.log_likelihood, none.log_likelihood)
        if clear.log_likelihood - unclear > SURE:
            self.open[handle] = False

    def _suspect(self, handle: int, evidence: WiringEvidence) -> None:
        """Accuse a handle if what both handles do fits together, and goes on to."""
        own, across = (0.0, pi / 2)[handle], (pi / 2, 0.0)[handle]
        joints = [Joint(Sector(own + pi, pi / 4, LEAST, MOST), _line(across))]
        if self.open[1 - handle]:  # else that axis is the other handle's
            half = (3 * pi / 4 - WRONG_RAD) / 2
            joints += [
                Joint(Sector(own + side * (WRONG_RAD + half), half, LEAST, MOST), _line(own, LEAST))
                for side in (-1, 1)
            ]
        wrong = evidence.against(handle, Sector(own, RIGHT_RAD, 0.0, MOST), joints)
        if wrong.log_likelihood <= ALARM:
            self._suspected[handle] = 0
            return
        self._suspected[handle] += 1
        if self._suspected[handle] >= TIMES:
            raise _error(handle, wrong.response)


def _time(past: tuple[float, list[float], float]) -> float:
    return past[0]


def _line(direction: float, least: float = 0.0) -> tuple[Sector, Sector]:
    """Responses about an axis, either way."""
    return (
        Sector(direction, pi / 4, least, MOST),
        Sector(direction + pi, pi / 4, least, MOST),
    )


def _error(handle: int, response: Pair) -> WiringError:
    """Say how a handle turns the tip, and what to do.

    Args:
        handle: 0 for up_down, 1 for left_right.
        response: the tip's bend per handle angle.
    """
    name, other = AXES[handle], AXES[1 - handle]
    own = response[handle]
    angle = degrees(atan2(response[1], response[0]) - (0.0, pi / 2)[handle])
    rotated = f"{round(-(angle + 180) % 360 - 180, -1):+.0f}"
    where = f"its bend changes by ({response[0]:+.2f}, {response[1]:+.2f}) rad per rad"
    if abs(own) > abs(response[1 - handle]):
        return WiringError(
            f"handle {name} turns the tip the wrong way: {where}",
            f"change the sign of direction in [handle.{name}] of bench.toml; or, if the camera is "
            "rotated by about 180 deg, rotate it back (on the twin: instrument.misalignment_rad)",
            axis=name,
        )
    return WiringError(
        f"handle {name} turns the tip about the axis {other}: {where}",
        f"exchange the ids of [handle.{name}] and [handle.{other}] in bench.toml; or, if the "
        f"camera is rotated by about {rotated} deg, rotate it back (on the twin: "
        "instrument.misalignment_rad)",
        axis=name,
    )
