"""Kalman filters of one axis of the target: it stays, or it continues at its velocity.

Reference:
    Y. Bar-Shalom, X. R. Li and T. Kirubarajan, Estimation with Applications to Tracking and
    Navigation, 2001, ch. 6 (white-noise acceleration).
"""

from __future__ import annotations

from dataclasses import dataclass

START_SPEED_RAD_S = 0.5
"""Standard deviation of the velocity before it is measured [rad/s]. Assumed: a slow swing."""


@dataclass
class AxisFilter:
    """Place and velocity of one axis, with white acceleration."""

    density: float
    """Spectral density of the acceleration [rad2/s3]; of the velocity where `still` [rad2/s]."""
    still: bool = False
    """Whether it is a random walk, without velocity."""
    t: float | None = None
    """Time of the newest place [s]."""
    place: float = 0.0
    """Estimated place [rad]."""
    velocity: float = 0.0
    """Estimated velocity [rad/s]."""
    covariance: tuple[float, float, float] = (1.0, 0.0, 1.0)
    """Variance of the place, covariance, variance of the velocity."""

    def update(self, t: float, place: float, variance: float) -> None:
        """Add one measured place; one that is not newer is ignored."""
        if self.t is None:
            self.t, self.place, self.velocity = t, place, 0.0
            self.covariance = variance, 0.0, 0.0 if self.still else START_SPEED_RAD_S**2
            return
        dt = t - self.t
        if dt <= 0:
            return
        a, b, c = self.covariance
        q = self.density
        if self.still:
            a += q * dt
        else:
            a += 2 * b * dt + c * dt**2 + q * dt**3 / 3
            b += c * dt + q * dt**2 / 2
            c += q * dt
        gain, slope = a / (a + variance), b / (a + variance)
        expected = self.place + self.velocity * dt
        self.place = expected + gain * (place - expected)
        self.velocity += slope * (place - expected)
        self.covariance = (1 - gain) * a, (1 - gain) * b, c - slope * b
        self.t = t

    def ahead(self, dt: float) -> float:
        """Predict the place a time after the newest one [rad]."""
        return self.place + self.velocity * dt
