"""Samples cut around their faces' boxes, before they are kept."""

from dataclasses import replace

import numpy as np
import pytest

from pix2face.geometry.crops import FaceBox
from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM
from pix2face.shards.layers import LAYERS, to_stored
from tests.synthetic_models import small_head_model
from tests.training.conftest import head_triplet
from training.data.cropping import (
    MARGIN_SHARE,
    ROUGH_SHARE,
    ROUGH_SHIFT,
    ROUGH_SIZE_SPREAD,
    SIZE_SPREAD,
    cut_around_box,
)
from training.data.decoded_sample import DecodedSample

SIZE_PX, SCALE = 64, 1.5
SIDE_PX = SIZE_PX + round(SIZE_PX * MARGIN_SHARE)


@pytest.fixture(scope="module")
def sample() -> DecodedSample:
    made = head_triplet(small_head_model(), 3)
    steps = {name: to_stored(LAYERS[name], made.layers[name]) for name in ("pncc", "offset", "mask")}
    return DecodedSample(
        **steps, image=made.image, seen=None, corner=(0, 0), landmarks2d=made.landmarks2d.astype(np.float32)
    )


def test_most_faces_are_in_the_middle_and_nearly_of_the_size_asked_for(sample: DecodedSample) -> None:
    close, rough = [], []
    for number in range(300):
        cut = cut_around_box(sample, number, SIZE_PX, SCALE)
        assert cut.image.shape == (SIDE_PX, SIDE_PX, 3)
        box = FaceBox.around(cut.landmarks2d)
        shift = np.abs(box.centre - SIDE_PX / 2).max() / box.longer_side
        (close if shift < 1e-4 else rough).append((SIZE_PX / SCALE / box.longer_side, shift))
    assert abs(len(rough) / 300 - ROUGH_SHARE) < 0.07
    for found, spread in ((np.array(close), SIZE_SPREAD), (np.array(rough), ROUGH_SIZE_SPREAD)):
        assert 1 - spread - 1e-6 <= found[:, 0].min() < 1 - 0.7 * spread
        assert 1 + 0.7 * spread < found[:, 0].max() <= 1 + spread + 1e-6
    assert 0.7 * ROUGH_SHIFT < np.array(rough)[:, 1].max() <= ROUGH_SHIFT + 1e-6


def test_a_sample_is_always_cut_alike(sample: DecodedSample) -> None:
    first, again, other = (cut_around_box(sample, number, SIZE_PX, SCALE) for number in (5, 5, 6))
    assert first.to_bytes() == again.to_bytes() != other.to_bytes()


def test_maps_stay_with_the_picture(sample: DecodedSample) -> None:
    """Our heads are as bright as they are near: what the picture shows, the maps must say of the same pixels."""
    cut = cut_around_box(sample, 0, 2 * SIZE_PX, SCALE)
    left, top = cut.corner
    face = cut.image[top : top + len(cut.mask), left : left + cut.mask.shape[1], 0][cut.mask > 0].astype(float)
    whole_left, whole_top = sample.corner
    height, width = sample.mask.shape
    whole = sample.image[whole_top : whole_top + height, whole_left : whole_left + width, 0][sample.mask > 0]
    points = (cut.pncc + cut.offset)[cut.mask > 0] / FIXED_POINT_STEPS_PER_MM
    before = (sample.pncc + sample.offset)[sample.mask > 0] / FIXED_POINT_STEPS_PER_MM
    design = np.column_stack([before, np.ones(len(before))])
    coefficients = np.linalg.lstsq(design, whole.astype(float), rcond=None)[0]
    errors = np.abs(np.column_stack([points, np.ones(len(points))]) @ coefficients - face)
    assert np.median(errors) < 2
    assert np.ptp(face) > 40


def test_no_face_leaves_empty_maps(sample: DecodedSample) -> None:
    nothing = replace(sample, mask=np.zeros_like(sample.mask))
    cut = cut_around_box(nothing, 0, SIZE_PX, SCALE)
    assert not cut.mask.size
    assert cut.image.any()
