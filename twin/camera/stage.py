"""The scene of a scenario: board, occluders, light and camera, ready to compile."""

from __future__ import annotations

import mujoco

from endolock.twin.camera import optics
from endolock.twin.model import scene
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import Scenario


def build(
    scenario: Scenario, instrument: Instrument | None = None, numerics: Numerics | None = None
) -> mujoco.MjSpec:
    """Build section and scene of a scenario; the tip camera renders what its optics need.

    Args:
        scenario: its board, light, camera and occluders are used.
        instrument: parameters of the section; the defaults if None.
        numerics: resolution of the simulation; the defaults if None.
    """
    plates = tuple(scene.Plate(plate.size_m, plate.look) for plate in scenario.occluder)
    light = scenario.light
    facets = scene.FACETS if light.falls_off else 1
    spec = scene.build(instrument, numerics, scenario.board.kind, plates, facets)
    scene.set_light(spec, light.room, light.tip, light.back, falls_off=light.falls_off)
    shot = optics.shot(scenario.camera)
    spec.visual.global_.offwidth = max(640, shot.width)
    spec.visual.global_.offheight = max(480, shot.height)
    spec.camera("tip").fovy = shot.fovy_deg
    return spec


def movable(model: mujoco.MjModel) -> list[int]:
    """Return the mocap indices of the board and of the occluders, in this order."""
    bodies = [model.body(n) for n in range(model.nbody)]
    plates = [body for body in bodies if body.name.startswith("occluder_")]
    return [int(body.mocapid[0]) for body in (model.body("target"), *plates)]
