"""Eyes that need no pictures, with the noise of their scenario: the same in runs and episodes."""

from __future__ import annotations

from endolock.hw.api import Truth
from endolock.twin.randomness import generator
from endolock.twin.rig import TwinRig
from endolock.twin.world.scenario import Scenario
from endolock.vision.truth_eyes import TruthEyes


def eyes_of_truth(truth: Truth, scenario: Scenario, seed: int) -> TruthEyes:
    """Make eyes that need no pictures, with the noise `camera.truth_noise_px` of the scenario.

    Args:
        truth: ground truth of the simulation.
        scenario: gives the noise.
        seed: seed of that noise.
    """
    noise = generator(seed, "vision.noise")
    turns = generator(seed, "vision.turns")
    return TruthEyes(truth, scenario.camera.truth_noise_px, noise, turns)


def exact_eyes(rig: TwinRig) -> TruthEyes:
    """Make the eyes of a rig that need no pictures, with the noise of its scenario and seed."""
    return eyes_of_truth(rig.truth, rig.scenario, rig.seed)
