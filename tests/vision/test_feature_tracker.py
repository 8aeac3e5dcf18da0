"""The feature tracker against exact projections: accuracy for every window, no false locks."""

import numpy as np
import pytest

from endolock.scripts.studies import sequences, vision_accuracy
from endolock.vision.feature_tracker import FeatureTracker, FollowedTarget
from endolock.vision.reference import Affine, normalised, select


@pytest.fixture(scope="module")
def clean() -> list[sequences.LabelledPicture]:
    return list(sequences.moving("line", 60))


@pytest.mark.parametrize("half", vision_accuracy.WINDOWS)
@pytest.mark.parametrize("board", ["rings", "tissue"])
def test_no_window_loses_a_clean_target(half: int, board: str) -> None:
    result = vision_accuracy.follow(sequences.moving("circle", 40, board=board), half)
    assert result.refused == 0
    # acceptance limit; corners of printed targets are found to 0.02 px, of tissue to 0.03
    assert result.rms_px <= 0.05


@pytest.mark.parametrize("path", sequences.PATHS)
def test_a_hard_sequence_is_followed(path: str) -> None:
    result = vision_accuracy.follow(sequences.moving(path, 120, hard=True), sequences.HALF_PX)
    assert result.refused == 0
    assert result.rms_px <= 0.15  # acceptance limit; noise, blur and compression leave 0.06


@pytest.mark.parametrize("kind", sequences.OCCLUSIONS[::5], ids=str)
def test_hidden_targets_are_refused_and_found_again(kind: sequences.Occlusion) -> None:
    result = vision_accuracy.hide([kind])
    assert result.hidden > 5  # the plate does cover the target for a while
    assert result.accepted_hidden == 0
    assert result.wrong == 0
    assert result.latest < 2  # again within two frames


def test_every_refusal_has_a_reason_and_coasting_ends_with_the_target(
    clean: list[sequences.LabelledPicture],
) -> None:
    tracker = _tracker(clean[0])
    blank = np.full_like(clean[0].grey, 90)
    for _ in range(3):
        assert isinstance(why := tracker.step(blank), str)
        assert why
    assert isinstance(tracker.step(clean[1].grey), FollowedTarget)


def test_a_target_that_leaves_the_picture_is_refused(
    clean: list[sequences.LabelledPicture],
) -> None:
    tracker = _tracker(clean[0])
    u = clean[0].target_px[0]
    for n in range(1, 40):
        moved = np.roll(clean[0].grey, 20 * n, axis=1)
        moved[:, : 20 * n] = 90
        track = tracker.step(moved)
        if not isinstance(track, str):
            # whole pixels were shifted; the correlation of whole windows repeats to 0.02 px
            assert track.pixel[0] == pytest.approx(u + 20 * n, abs=0.05)
        if u + 20 * n > 640:
            assert isinstance(track, str)


def test_the_covariance_matches_the_noise(clean: list[sequences.LabelledPicture]) -> None:
    """The same picture with new noise: positions scatter as the covariance, within a factor."""
    random = np.random.default_rng(5)
    tracker = _tracker(clean[0])
    positions, expected = [], []
    for _ in range(60):
        noise = random.normal(0, 8, clean[0].grey.shape)
        noisy = np.clip(clean[0].grey + noise, 0, 255).astype(np.uint8)
        track = tracker.step(noisy)
        assert not isinstance(track, str)
        positions.append(track.pixel)
        expected.append(track.covariance[0])
    ratio = np.var(positions, axis=0).mean() / np.mean(expected)
    # points share windows: the number of independent ones is a guess
    assert 0.1 < ratio < 3


@pytest.mark.parametrize(
    ("centre", "half", "why"),
    [((5.0, 5.0), (20, 20), "beyond the picture"), ((320.0, 30.0), (20, 20), "too little texture")],
)
def test_a_window_that_cannot_be_followed_is_refused_with_a_reason(
    clean: list[sequences.LabelledPicture],
    centre: tuple[float, float],
    half: tuple[int, int],
    why: str,
) -> None:
    plain = clean[0].grey.copy()
    plain[:80] = 120
    with pytest.raises(ValueError, match=why):
        FeatureTracker(plain, centre, half)


def test_normalised_contrast_is_independent_of_gain_and_offset(
    clean: list[sequences.LabelledPicture],
) -> None:
    grey = clean[0].grey
    dim = (0.5 * grey + 20).astype(np.uint8)
    a, b = (normalised(g).astype(float) for g in (grey, dim))
    textured = np.abs(a - 128) > 30
    # the floor of 6 grey levels reduces low contrast, and levels are rounded
    assert np.corrcoef(a[textured], b[textured])[0, 1] > 0.99


def test_an_affine_map_is_its_matrix(clean: list[sequences.LabelledPicture]) -> None:
    affine = Affine(10 + 20j, 1.2 * np.exp(0.3j), 0.1 - 0.2j)
    matrix = affine.matrix(3 + 4j, affine.position)
    offsets = np.array([1 + 0j, 1j, -2 + 3j])
    moved = affine.position + affine.moves(offsets)
    for offset, position in zip(offsets, moved, strict=True):
        x, y = matrix @ [3 + offset.real, 4 + offset.imag, 1]
        assert (x, y) == pytest.approx((position.real, position.imag), abs=1e-12)  # rounding


def test_points_lie_in_the_window(clean: list[sequences.LabelledPicture]) -> None:
    reference = select(clean[0].grey, complex(*clean[0].target_px), (30, 15))
    assert not isinstance(reference, str)
    assert np.abs(reference.offsets.real).max() <= 31  # half a pixel of rounding and of the centre
    assert np.abs(reference.offsets.imag).max() <= 16


def _tracker(sight: sequences.LabelledPicture) -> FeatureTracker:
    return FeatureTracker(sight.grey, sight.target_px, (sequences.HALF_PX,) * 2)
