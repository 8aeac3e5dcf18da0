"""Axes and signs in rendered pictures of both cameras."""

from math import cos, pi, radians, sin

import cv2
import mujoco
import numpy as np
import pytest

from endolock.hw.api import Calibration, Command, ConfigError, Image, Vector
from endolock.twin.camera.renderer import Renderer
from endolock.twin.model import generate, scene
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario
from endolock.vision import camera_model
from endolock.vision.detector import MarkerDetector

LARGE = {0, 1, 2, 3}
"""Markers in the corners of the board; the small ones are too far away here."""


def _corners(image: Image, rig: TwinRig) -> dict[int, Vector]:
    """Return the marker corners found in a picture, by id."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return {i: corners for corners, i in MarkerDetector(rig.board)(np.asarray(grey, np.uint8))}


def _picture(rig: TwinRig, name: str = "tip") -> tuple[Image, Calibration]:
    index = scene.camera_id(rig.plant.model, name)
    calibration = camera_model.from_fovy(640, 480, float(rig.plant.model.cam_fovy[index]))
    renderer = Renderer(rig.plant.model)
    rig.plant.snapshot()
    rig.plant.draw_board()
    image = renderer.draw(rig.plant.data, index, 640, 480)
    renderer.close()
    return image, calibration


def _steered(up_down: float, left_right: float) -> TwinRig:
    rig = TwinRig("rest", pictures=False)
    rig.actuators.connect()
    rig.actuators.enable()
    rig.actuators.exchange(Command(position=(up_down, left_right), valid_for=9.0))
    rig.clock.sleep_until(0.1)
    rig.actuators.exchange(None)
    rig.clock.sleep_until(1.0)
    return rig


def test_the_board_is_upright_and_in_the_middle() -> None:
    rig = TwinRig("rest", pictures=False)
    corners = _corners(_picture(rig)[0], rig)
    centres = {i: corners[i].mean(axis=0) for i in LARGE}
    top_left, top_right, bottom_right, bottom_left = (centres[i] for i in range(4))
    assert top_left[0] < top_right[0]
    assert top_left[1] < bottom_left[1]
    assert bottom_right[0] > bottom_left[0]
    # markers are found to 0.15 px; the mean of 16 corners is better
    assert np.mean(list(centres.values()), axis=0) == pytest.approx((319.5, 239.5), abs=0.1)


@pytest.mark.parametrize(
    ("handles", "shift"),
    [((0.4, 0.0), (0, 1)), ((-0.4, 0.0), (0, -1)), ((0.0, 0.4), (-1, 0)), ((0.0, -0.4), (1, 0))],
)
def test_positive_handles_turn_the_view_up_and_right(
    handles: tuple[float, float], shift: tuple[int, int]
) -> None:
    """Turning up moves a still target down in the picture, turning right moves it left."""
    rig = _steered(*handles)
    corners = _corners(_picture(rig)[0], rig)
    moved = np.mean([corners[i].mean(axis=0) for i in LARGE], axis=0) - (319.5, 239.5)
    along, across = moved @ shift, moved @ (shift[1], shift[0])
    assert along > 20  # 0.4 rad less the width of the hysteresis moves the picture by 50 px
    assert abs(across) < 1  # the other axis is not coupled beyond rounding and detection noise
    bend = rig.truth.now().plant.bend_rad
    assert np.sign(np.round(bend, 6)).tolist() == np.sign(handles).tolist()


@pytest.mark.parametrize("handles", [(0.0, 0.0), (0.3, 0.5), (-0.4, 0.2)])
def test_pictures_agree_with_the_pinhole(handles: tuple[float, float]) -> None:
    rig = _steered(*handles)
    image, calibration = _picture(rig)
    corners = _corners(image, rig)
    plant, rotation = rig.plant.explain(rig.plant.snapshot())
    assert corners
    for marker, found in corners.items():
        points = rig.board.corners()[marker] + plant.board.position
        expected = [
            camera_model.project(calibration, (p - plant.tip.position) @ rotation) for p in points
        ]
        # half a pixel: rasterisation and sub-pixel refinement together
        assert np.abs(found - expected).max() < 0.5


def test_base_frame_is_the_camera_at_rest() -> None:
    plant = TwinRig("rest", pictures=False).truth.now().plant
    assert plant.tip.position == pytest.approx((0, 0, 0), abs=1e-12)  # by definition; rounding
    assert np.abs(plant.tip.quaternion) == pytest.approx((1, 0, 0, 0), abs=1e-12)
    assert plant.backbone[0] == pytest.approx((0, 0, -0.09), abs=1e-9)  # 75 mm and 15 mm of tip


UNSEEN = {"close", "close_random", "occlusion", "leave_and_return"}


@pytest.mark.parametrize("name", sorted({*scenario.names()} - UNSEEN))
def test_the_fixed_camera_sees_the_large_markers_throughout(name: str) -> None:
    """In all scenarios but those with the board at the tip, behind something, or out of view."""
    rig = TwinRig(name, pictures=False)
    for t in np.linspace(0.0, rig.scenario.duration_s, 9):
        # The position of the board follows from the step count alone; the section may stay at rest.
        rig.plant.step_count = round(t / rig.plant.timestep_s)
        corners = _corners(_picture(rig, "overview")[0], rig)
        assert corners.keys() >= LARGE, f"at {t:.1f} s"


def test_the_fixed_camera_sees_the_section() -> None:
    rig = TwinRig("rest", pictures=False)
    renderer = mujoco.Renderer(rig.plant.model, 480, 640)
    renderer.enable_segmentation_rendering()
    rig.plant.draw_board()
    renderer.update_scene(rig.plant.data, "overview")
    geoms = renderer.render()[..., 0]
    renderer.close()
    rings = [
        i
        for i in range(rig.plant.model.ngeom)
        if "ring_" in rig.plant.model.body(rig.plant.model.geom_bodyid[i]).name
    ]
    seen = {int(i) for i in np.unique(geoms)} & set(rings)
    assert seen == set(rings)


def test_an_unknown_camera_name_is_refused() -> None:
    model = scene.build().compile()
    message = "camera 'tipp' is not in models/endoscope/scene.xml; use overview, tip"
    with pytest.raises(ConfigError, match=message):
        scene.camera_id(model, "tipp")


def test_the_committed_scene_runs_without_the_twin_and_without_warnings() -> None:
    """As in `python -m mujoco.viewer`: one second of random control without the twin."""
    model = mujoco.MjModel.from_xml_path(str(generate.folder() / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    for n in range(500):
        phase = 2 * pi * n / 500
        data.ctrl[:] = [radians(40) * sin(phase), radians(40) * cos(3 * phase)]
        mujoco.mj_step(model, data)
    assert sum(int(w.number) for w in data.warning) == 0
    assert np.isfinite(data.qpos).all()
