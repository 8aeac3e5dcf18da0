"""What a guard checks: the values of commands; that answers come, goals arrive, handles follow."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from math import inf, isfinite

from endolock.hw.api import PERIOD_S, Command, CommandError, DeviceFault, LinkLost
from endolock.hw.drive import Reading
from endolock.hw.errors import RESUME
from endolock.hw.strict import shown

LAG = 3
"""A motor may report one of this number of goals sent last. Assumed."""


@dataclass(frozen=True, kw_only=True)
class GuardSettings:
    """Thresholds of a guard."""

    following_error_rad: float = 0.5
    """Largest distance of a handle from its goal [rad]. Assumed: at full speed a servo lags by
    0.1 rad, and a blocked handle is off by 0.5 rad after 0.15 s."""
    following_time_s: float = 0.2
    """A larger distance for longer than this [s] is a fault. Assumed."""
    max_age_s: float = 0.25
    """The link counts as lost when answers are missing for longer than this [s]; a pause of the
    program itself does not count.

    Silence moves nothing: a motor stays at the last goal that arrived, and the goal waits after
    `max_slew_step_s`. Measured on two cores with six times the work they can do: an emulated bench
    leaves up to four requests in a row unanswered, for up to 0.22 s. It has to be shorter than the
    watchdog of a motor, 0.4 s, so that the reason is reported before the motor stops by itself."""
    max_slew_step_s: float = 0.1
    """After a pause, and while no answer comes, the goal moves at most as far as it may within
    this time [s]. Assumed."""


class Checks:
    """Checks of the readings of one guard.

    Args:
        axes: names of the axes.
        settings: thresholds.
    """

    def __init__(self, axes: Sequence[str], settings: GuardSettings) -> None:
        self._axes, self._settings = tuple(axes), settings
        self.restart(0.0)

    def restart(self, now: float) -> None:
        """Begin at `now` [s]: all times of checks are counted from there."""
        self._fresh_at = self._taken_at = now
        self._off_since: list[float | None] = [None] * len(self._axes)
        self._unanswered = 0
        self._sent: deque[tuple[float, ...]] = deque(maxlen=LAG)

    def age(self, reading: Reading, now: float) -> None:
        """Check that answers come.

        Raises:
            LinkLost: none came for longer than allowed.
        """
        if reading.fresh:
            self._unanswered, self._fresh_at = 0, now
            return
        self._unanswered += 1
        if self._unanswered == 1:
            # A pause of the program itself is no silence.
            self._fresh_at = max(self._fresh_at, now - PERIOD_S)
        # A single missing answer is no loss, however long ago the one before was.
        if self._unanswered > 1 and now - self._fresh_at > self._settings.max_age_s:
            who = " and ".join(reading.silent) or "the handles"
            raise LinkLost(
                f"no answer from {who} for {now - self._fresh_at:.3f} s; the goal is frozen",
                "check cable and power",
                recovery=RESUME,
                t=now,
                axis=reading.silent[0] if reading.silent else None,
            )

    def waiting(self, now: float) -> bool:
        """Return whether answers have been missing for so long that the goal has to wait."""
        return self._unanswered > 1 and now - self._fresh_at > self._settings.max_slew_step_s

    def taken(self, reading: Reading, sent: tuple[float, ...], now: float) -> None:
        """Check that goals arrive, where the motors report theirs.

        Args:
            reading: as measured.
            sent: the goals sent, as the motors represent them [rad].
            now: the time [s].

        Raises:
            LinkLost: none arrived for longer than allowed, though the motors answer.
        """
        # An answer may be to the request before: where a busy bus lags, goals still arrive.
        self._sent.append(sent)
        if reading.goal is None or reading.goal in self._sent:
            self._taken_at = now
        elif reading.fresh and now - self._taken_at > self._settings.max_age_s:
            pairs = zip(self._axes, reading.goal, sent, strict=True)
            axis = next(axis for axis, has, goal in pairs if has != goal)
            raise LinkLost(
                f"no goal reached {axis} for {now - self._taken_at:.3f} s, though it answers; the "
                "goal is frozen",
                "check the cable",
                recovery=RESUME,
                t=now,
                axis=axis,
            )

    def following(self, reading: Reading, goal: Sequence[float], now: float) -> None:
        """Check that the handles follow their goals.

        Args:
            reading: as believed.
            goal: their goals [rad].
            now: the time [s].

        Raises:
            DeviceFault: one is too far from its goal, for too long.
        """
        settings = self._settings
        for i, axis in enumerate(self._axes):
            error = goal[i] - reading.position[i]
            if abs(error) <= settings.following_error_rad:
                self._off_since[i] = None
                continue
            since = self._off_since[i]
            if since is None:
                self._off_since[i] = now
            elif now - since > settings.following_time_s:
                raise DeviceFault(
                    f"handle {axis} is {error:+.2f} rad from its goal for more than "
                    f"{settings.following_time_s:g} s; the goal is frozen where it stands",
                    "free the handle",
                    recovery=RESUME,
                    kind="following",
                    t=now,
                    axis=axis,
                )


def values(command: Command, axes: Sequence[str], now: float) -> tuple[float, ...]:
    """Return the position that a command asks for [rad].

    Args:
        command: as given.
        axes: names of the axes.
        now: the time [s].

    Raises:
        CommandError: it is no command, has a wrong length, is not of finite numbers, or does not
            expire.
    """
    if not isinstance(command, Command):
        raise CommandError(
            f"got {shown(command)}, which is not a command",
            "give Command(position=...), angles in rad (the previous goal stays)",
            t=now,
        )
    try:
        if isinstance(command.position, str | bytes | Mapping | Set):
            raise TypeError  # "12" is not two angles
        position, valid_for = tuple(map(float, command.position)), float(command.valid_for)
    except (TypeError, ValueError, OverflowError):
        raise CommandError(
            f"command {command.position!r}, valid for {command.valid_for!r} s, is not of numbers",
            "give angles in rad and a time in s (the previous goal stays)",
            t=now,
        ) from None
    if len(position) != len(axes):
        raise CommandError(
            f"command has {len(position)} positions",
            f"give {len(axes)}: {', '.join(axes)}",
            t=now,
        )
    for axis, value in zip(axes, position, strict=True):
        if not isfinite(value):
            raise CommandError(
                f"command for {axis} is {value}",
                "give a finite angle in rad (the previous goal stays)",
                t=now,
                axis=axis,
            )
    if not 0 < valid_for < inf:
        raise CommandError(
            f"command is valid for {command.valid_for} s",
            "give a finite time of more than 0 (the previous goal stays)",
            t=now,
        )
    return position
