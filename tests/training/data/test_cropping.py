"""Samples cut around their faces' boxes, before they are kept."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pix2face.geometry.crops import FaceBox
from pix2face.geometry.jitter import JitterRange
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
from training.data.dataset import DrawDataset
from training.data.decoded_sample import DecodedSample
from training.data.shard_index import index_shards
from training.recipe.presets import PRESETS
from training.recipe.recipe import Cropping

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


@pytest.mark.parametrize("cropping", ["full", "box", "none"])
def test_landmarks_stay_on_the_face_also_in_the_mirror(shards_dir: Path, cropping: Cropping) -> None:
    """PNCC under a landmark is that landmark's vertex of the mean face."""
    model = small_head_model()
    jitter = JitterRange(scale=(1.4, 1.8), shift=0.1, rotation_deg=25.0, mirror=True)
    recipe = replace(PRESETS["cpu"], size_px=64, cropping=cropping, n_landmarks=68, jitter=jitter)
    batch = DrawDataset(index_shards([shards_dir]), recipe).batch(range(10))
    distances = []
    for place in range(10):
        landmarks, mask = batch.landmarks2d[place].numpy(), batch.mask[place].numpy() > 0
        column, row = np.clip(np.floor(landmarks).astype(int), 0, 63).T
        found = batch.pncc[place].permute(1, 2, 0).numpy()[row, column] / FIXED_POINT_STEPS_PER_MM
        distance = np.linalg.norm(found - model.mean[model.landmarks["ibug68"]], axis=1)
        distances.append(distance[mask[row, column]])
    together = np.concatenate(distances)
    assert len(together) > 400
    assert np.median(together) < 6  # a pixel shows 4 to 7 mm
