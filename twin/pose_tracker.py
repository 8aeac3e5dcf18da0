"""The twin's pose tracker: poses of the tip with noise, latency and dropouts."""

from __future__ import annotations

from collections import deque
from math import radians

from endolock.hw import rotation
from endolock.hw.api import Clock, Pose
from endolock.twin.physics.plant import TwinPlant
from endolock.twin.randomness import generator
from endolock.twin.world.scenario_sections import PoseTrackerSettings


class TwinPoseTracker:
    """Poses of the tip as a rigid body, as an optical tracker delivers them.

    Args:
        settings: rate, latency, noise and dropouts.
        plant: the plant whose tip it measures.
        clock: decides which poses have arrived.
        seed: seed of noise and dropouts.
    """

    def __init__(
        self, settings: PoseTrackerSettings, plant: TwinPlant, clock: Clock, seed: int
    ) -> None:
        self._settings, self._plant, self._clock = settings, plant, clock
        self._noise = generator(seed, "tracker.noise")
        self._drops = generator(seed, "tracker.drops")
        self._line: deque[Pose] = deque()
        self._newest: Pose | None = None
        self._samples = 0

    def due_step(self) -> int:
        """Grid step of the next measurement."""
        return round(self._samples / self._settings.rate_hz / self._clock.timestep_s)

    def measure(self) -> None:
        """Measure now, and send the pose.

        The noise is normal and isotropic: added to the position, and applied as a small rotation in
        the axes of the tip.
        """
        self._samples += 1
        settings = self._settings
        shift = settings.position_noise_m * self._noise.standard_normal(3)
        turn = radians(settings.rotation_noise_deg) * self._noise.standard_normal(3)
        if self._drops.random() < settings.drop_fraction:
            return
        true = self._plant.tip_pose()
        x, y, z = (true.position + shift).tolist()
        turned = rotation.product(true.quaternion, rotation.from_vector(turn.tolist()))
        self._line.append(Pose(t=true.t, position=(x, y, z), quaternion=turned))

    def latest(self) -> Pose | None:
        """Return the newest pose delivered so far; see `PoseTracker.latest`."""
        arrived = self._clock.now() - self._settings.latency_s + 1e-9
        while self._line and self._line[0].t <= arrived:
            self._newest = self._line.popleft()
        return self._newest
