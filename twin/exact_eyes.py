"""Eyes that need no pictures, with the noise of their scenario: the same in runs and episodes."""

from __future__ import annotations

from endolock.hw import boards
from endolock.hw.api import Truth
from endolock.twin.camera import optics
from endolock.twin.randomness import generator
from endolock.twin.rig import TwinRig
from endolock.twin.world.scenario import Scenario
from endolock.vision.truth_eyes import TrueTurns, TruthEyes


def eyes_of_truth(truth: Truth, scenario: Scenario, seed: int) -> TruthEyes:
    """Make eyes that need no pictures, with the noise `camera.truth_noise_px` of the scenario.

    They measure the rotation of the camera unless `camera.background` is false.

    Args:
        truth: ground truth of the simulation.
        scenario: gives the noise and the camera.
        seed: seed of that noise.
    """
    camera = scenario.camera
    noise, turns = generator(seed, "vision.noise"), None
    if camera.background:
        lens = optics.calibration(camera)
        turns = TrueTurns(lens, boards.SIZE_M, generator(seed, "vision.turns"))
    return TruthEyes(truth, camera.truth_noise_px, noise, turns)


def exact_eyes(rig: TwinRig) -> TruthEyes:
    """Make the eyes of a rig that need no pictures, with the noise of its scenario and seed."""
    return eyes_of_truth(rig.truth, rig.scenario, rig.seed)
