"""Reference play of one axis: which motions of the target the handle follows, at one stated price.

The desired bend follows the predicted place of the target with a play, so that noise and small
motions do not turn the handle back and forth through its loop. In the direction of motion it stays
a lag of `LAG` r behind; it turns back once the mean prediction over the next moments is 2 r - lag
on the other side. Plays of several half-widths r run side by side on the same predictions. Each is
charged for what it would have cost,

    J = ln(e^2 + 1 px^2) + v / PRICE_RAD_S,

with e its rms error against the places seen later, and v the travel of the handle per second, a
width of the loop at every turn. The cheapest is used. The last one only drifts with the mean of the
target's place, as good as never moving. Where the bend is not measured, what the offsets that were
really seen exceed the e of the play in use by is charged to all others: a wrong model of the
transmission makes motion look better than it is.

Reference:
    K. J. Astrom and B. Bernhardsson, Systems with Lebesgue sampling, 2003 (act only on deviations
    that are worth it).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import copysign, exp, log

REACHES_RAD = (0.001, 0.002, 0.004, 0.008, 0.016, 0.032, 0.048, 0.064, 0.09, 10.0)
"""Half-widths r that are compared [rad]; the last one stands for no play but a slow mean."""
MEAN_S = 10.0
"""Time constant of that mean [s]. Assumed."""
LAG = 0.6
"""Distance behind the prediction while following it, in r [1]. Source: tuned on random motions;
1 is a plain play."""
PRICE_RAD_S = 0.6
"""Travel of the handle per second that is worth a mean squared error e times smaller [rad/s].
Assumed: breathing of 10 mm is followed, a heartbeat of 1.5 mm is not."""
MEMORY_S = 10.0
"""Time constant of errors and travel [s]. Assumed: two or three turns of the target."""
JUDGED_S = 1.5
"""Time over which the plays are compared before one is chosen [s]. Assumed."""
CLEARLY = 0.05
"""Gain in J above which another play is chosen [1]."""
START = 4
"""Index of the first play."""
CHANGED_RAD = 0.02
"""Change of the model's bend after which the excess of the old model hardly counts [rad].
Assumed."""
DOUBT = 0.7
"""Logarithm of the squared error by which motion must be better than none while the transmission is
not known [1]. Assumed: a factor of two."""
SETTLE_S = 3.0
"""Time for which new predictions are not judged [s]. Assumed."""
FRAME_S = 0.04
"""Time for which one judgement counts [s]. Assumed: 25 frames per second; at more of them the times
above are shorter than stated."""
LEAST_RAD = 1e-9
"""Motion that shows a turn [rad]."""


class ReferencePlay:
    """The plays of one axis, side by side, and the one in use.

    Args:
        place: where all of them start [rad].
    """

    def __init__(self, place: float) -> None:
        count = len(REACHES_RAD)
        # plain numbers: for so few, arrays take ten times as long
        self._places, self._directions = [place] * count, [0.0] * count
        self._errors, self._travel = [0.0] * count, [0.0] * count
        self._judged_s = self._moved_s = 0.0
        self._off = self._excess = self._seen_s = 0.0
        self._said: deque[tuple[float, list[float]]] = deque()
        self._chosen = START
        self._place, self._direction = place, 0.0

    @property
    def reach_rad(self) -> float:
        """Half-width of the play in use [rad]."""
        return REACHES_RAD[self._chosen]

    @property
    def place(self) -> float:
        """Output of the play in use [rad]."""
        return self._place

    @property
    def usual(self) -> float:
        """Mean place of the target over the last `MEAN_S` or so [rad]."""
        return self._places[-1]

    @property
    def direction(self) -> float:
        """Direction of its last motion: 1, -1, or 0 before any."""
        return self._direction

    def follow(
        self, when: float, aim: float, mean: float, *, dt: float, slope: float, width: float
    ) -> float:
        """Move all plays; return the output of the one in use [rad].

        Args:
            when: time for which the target is predicted [s].
            aim: predicted place at that time [rad].
            mean: mean prediction over the moments after it [rad].
            dt: time since the last call [s].
            slope: bend per handle angle [rad/rad].
            width: width of the loop at the handle [rad].
        """
        before, turned = self._places, self._directions
        followed = [
            _followed(place, way, aim, mean, reach)
            for place, way, reach in zip(before, turned, REACHES_RAD, strict=True)
        ]
        drift = aim - before[-1]
        side = copysign(1.0, drift) if drift else 0.0
        followed[-1] = before[-1] + min(dt / MEAN_S, 1.0) * drift, side
        self._places = [place for place, _ in followed]
        self._directions = [way for _, way in followed]
        self._moved_s += dt
        share = _share(dt, self._moved_s)
        for n, (place, way) in enumerate(followed):
            turns = width if way != turned[n] != 0 else 0.0
            moved = abs(place - before[n]) / slope + turns
            self._travel[n] += share * (moved / dt - self._travel[n])
        self._said.append((when, self._places))
        if self._chosen == len(REACHES_RAD) - 1:
            self._place, self._direction = followed[-1]
        else:
            self._place, self._direction = _followed(
                self._place, self._direction, aim, mean, self.reach_rad
            )
        return self._place

    def ahead(self, aims: Sequence[float]) -> float:
        """Output of the play in use after more predictions, which leaves it unchanged [rad]."""
        place, direction = self._place, self._direction
        for aim in aims:
            place, direction = _followed(place, direction, aim, aims[-1], self.reach_rad)
        return place

    def judge(
        self, t: float, seen: float, off: float | None, px_per_rad: float, *, known: bool = True
    ) -> None:
        """Compare the plays with where the target was seen, and choose one.

        Args:
            t: time of the exposure [s].
            seen: place of the target at that time [rad].
            off: its offset from the optical axis at that time [rad]; None where the bend is
                measured.
            px_per_rad: pixels per bend [px/rad].
            known: whether the transmission is known; else motion must be worth it by far.
        """
        due: tuple[float, list[float]] | None = None
        while self._said and self._said[0][0] <= t:
            due = self._said.popleft()
        if due is None or t - due[0] > 0.1:  # nothing was said for this time
            return
        self._judged_s += FRAME_S
        share = _share(FRAME_S, self._judged_s)
        self._errors = [
            error + share * ((px_per_rad * (place - seen)) ** 2 - error)
            for error, place in zip(self._errors, due[1], strict=True)
        ]
        excess = 0.0
        if off is not None:
            if self._chosen < len(REACHES_RAD) - 1:
                self._seen_s += FRAME_S
                part = _share(FRAME_S, self._seen_s)
                self._off += part * ((px_per_rad * off) ** 2 - self._off)
                self._excess = max(self._off - self._errors[self._chosen], 0.0)
            excess = self._excess
        if self._judged_s < JUDGED_S:
            return
        doubt = 0.0 if known else DOUBT
        costs = [
            log(error + 1.0 + excess) + travel / PRICE_RAD_S + doubt
            for error, travel in zip(self._errors, self._travel, strict=True)
        ]
        costs[-1] = log(self._errors[-1] + 1.0) + self._travel[-1] / PRICE_RAD_S
        best = min(range(len(costs)), key=costs.__getitem__)
        if costs[best] < costs[self._chosen] - CLEARLY:
            self._chosen = best

    def move(self, by: float) -> None:
        """Shift all outputs by a change of the model [rad], with which its excess counts anew."""
        self._seen_s = min(self._seen_s, self._seen_s * exp(-abs(by) / CHANGED_RAD))
        self._places = [place + by for place in self._places]
        self._place = self._place + by
        self._said = deque((when, [one + by for one in places]) for when, places in self._said)

    def learn_anew(self) -> None:
        """Count only what is said from now on, as the predictions are of another kind."""
        self._judged_s = self._moved_s = self._seen_s = -SETTLE_S
        self._excess = 0.0
        self._chosen = START
        self._said.clear()

    def restart(self, place: float) -> None:
        """Put outputs but the mean at a place [rad], as after a gap; what was learnt is kept."""
        self._places = [place] * (len(REACHES_RAD) - 1) + self._places[-1:]
        self._place = place
        self._directions, self._direction = [0.0] * len(REACHES_RAD), 0.0
        self._said.clear()


def _share(dt: float, counted_s: float) -> float:
    """Share of a new value in a mean over `MEMORY_S`, or over the time counted if that is less."""
    return max(1 - exp(-dt / MEMORY_S), dt / max(counted_s, dt))


def _followed(
    place: float, direction: float, aim: float, mean: float, reach: float
) -> tuple[float, float]:
    """Output and direction of a play after one prediction."""
    lag = LAG * reach
    turn = 2 * reach - lag
    if (direction >= 0 and aim - lag > place) or (
        direction < 0 and mean > place + turn and aim > place
    ):
        return max(aim - lag, place + LEAST_RAD), 1.0
    if (direction <= 0 and aim + lag < place) or (
        direction > 0 and mean < place - turn and aim < place
    ):
        return min(aim + lag, place - LEAST_RAD), -1.0
    return place, direction
