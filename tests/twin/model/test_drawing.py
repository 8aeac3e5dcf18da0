"""The printed boards, and stills of them: everything is at its position in the geometry."""

from itertools import combinations

import numpy as np
import pytest

from endolock.hw import boards
from endolock.twin.camera.stills import BoardPose, Studio
from endolock.twin.model import drawing
from endolock.twin.world import scenario
from endolock.vision.detector import MarkerDetector
from endolock.vision.grey import grey_of, smoothed
from endolock.vision.marker_eyes import MarkerEyes


@pytest.mark.parametrize("kind", boards.all_boards())
def test_every_marker_is_found_in_the_print(kind: str) -> None:
    printed = boards.all_boards()[kind]
    geometry = printed.geometry
    found = {}
    for side_m, texels in ((boards.SIZE_M, drawing.TEXELS_PER_MM), (0.044, 24)):
        picture = drawing.picture(printed, side_m, texels)
        for corners, i in MarkerDetector(geometry)(smoothed(grey_of(picture))):
            expected = (geometry.corners()[i][:, :2] + side_m / 2) * 1e3 * texels - 0.5
            # edges lie between texels; corners of sharp squares are found to half a texel
            assert corners == pytest.approx(expected, abs=0.75)
            found[i] = corners
    assert found.keys() == {i for i, *_ in geometry.markers}


@pytest.mark.parametrize("kind", boards.all_boards())
def test_nothing_overlaps(kind: str) -> None:
    printed = boards.all_boards()[kind]
    squares = [(x, y, size / 2) for _, x, y, size in printed.geometry.markers]
    patches = [(p.x, p.y, p.radius) for p in printed.patches]
    for x, y, half in squares + patches:
        assert max(abs(x), abs(y)) + half < boards.SIZE_M / 2
    for (ax, ay, a), (bx, by, b) in combinations(squares, 2):
        # a marker needs a module of white around it, a sixth of its side
        assert max(abs(ax - bx), abs(ay - by)) > a + b + min(a, b) / 3 - 1e-9
    for x, y, half in squares:
        for px, py, radius in patches:
            nearest = np.maximum(np.abs([x - px, y - py]) - half, 0)
            assert np.hypot(*nearest) > radius
    for scale in (drawing.TEXELS_PER_MM, drawing.CENTRE_TEXELS_PER_MM):
        large = [s for _, x, _, s in printed.geometry.markers if (scale == 24) == (abs(x) < 0.02)]
        for size in large:
            modules = 1e3 * size * scale / 6
            if scale == drawing.CENTRE_TEXELS_PER_MM or size == 0.020:
                assert modules == pytest.approx(round(modules))  # whole texels


@pytest.mark.parametrize("kind", boards.all_boards())
@pytest.mark.parametrize(
    "place",
    [
        BoardPose((0.0, 0.0, 0.12)),
        BoardPose((0.02, -0.015, 0.1), tilt_deg=30.0, axis_deg=50.0, roll_deg=25.0),
        BoardPose((-0.004, 0.003, 0.06), tilt_deg=-20.0, axis_deg=110.0, roll_deg=-40.0),
    ],
)
def test_stills_show_the_board_where_it_is(kind: str, place: BoardPose) -> None:
    with Studio(scenario.load("rest", {"board.kind": kind})) as studio:
        still = studio.take(place)
        _, fit = MarkerEyes(studio.calibration, studio.board).look(still.frame)
    assert not isinstance(fit, str)
    assert fit.pixel == pytest.approx(still.target_px, abs=0.3)  # each to 0.05-0.15 px
    assert fit.distance_m == pytest.approx(still.distance_m, rel=0.003)


def test_another_target_of_the_same_board() -> None:
    seen = []
    for number in range(4):
        overrides = {"board.kind": "several", "board.target": number}
        with Studio(scenario.load("rest", overrides)) as studio:
            still = studio.take(BoardPose((0.0, 0.0, 0.12)))
            seen.append(np.subtract(still.target_px, studio.calibration.centre_px))
    signs = [tuple(np.sign(s).astype(int).tolist()) for s in seen]
    assert signs == [(-1, -1), (1, -1), (-1, 1), (1, 1)]  # left is left, up is up
