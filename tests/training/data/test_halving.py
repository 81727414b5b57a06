import numpy as np
import pytest

from pix2face.geometry.crops import Crop
from pix2face.geometry.jitter import crop_maps
from pix2face.geometry.maps import FaceMaps, fixed_point_to_maps
from tests.synthetic_models import small_head_model
from tests.training.conftest import head_triplet
from training.data.decoded_sample import DecodedSample
from training.data.halving import halved


def sample_of(pncc: np.ndarray, mask: np.ndarray, corner: tuple[int, int], size_px: tuple[int, int]) -> DecodedSample:
    rng = np.random.default_rng(0)
    return DecodedSample(
        image=rng.integers(0, 256, (*size_px, 3)).astype(np.uint8),
        pncc=(pncc * mask[..., None]).astype(np.int16),
        offset=(-pncc * mask[..., None]).astype(np.int16),
        mask=mask.astype(np.uint8),
        seen=mask.astype(np.uint8),
        corner=corner,
        landmarks2d=np.array([[3.0, 5.0], [8.0, 1.0]], dtype=np.float32),
    )


def in_picture(sample: DecodedSample, steps: np.ndarray) -> np.ndarray:
    """A cut where it belongs in its picture."""
    whole = np.zeros((*sample.image.shape[:2], *steps.shape[2:]), steps.dtype)
    left, top = sample.corner
    height, width = whole.shape[0] - top, whole.shape[1] - left
    steps = steps[:height, :width]
    whole[top : top + steps.shape[0], left : left + steps.shape[1]] = steps
    return whole


@pytest.mark.parametrize("corner", [(0, 0), (1, 0), (0, 3), (5, 7)])
def test_it_is_what_the_crop_of_half_the_size_holds(corner):
    """Oracle: resampling with linear interpolation, which knows nothing of blocks."""
    triplet = head_triplet(small_head_model(), 3)
    rows, columns = np.s_[10:60], np.s_[12:63]
    pncc, mask = np.rint(triplet.layers["pncc"] * 128)[rows, columns], triplet.layers["mask"][rows, columns]
    sample = sample_of(pncc, mask, corner, (72, 72))
    half = halved(sample)
    whole = FaceMaps(
        fixed_point_to_maps(in_picture(sample, sample.pncc)),
        fixed_point_to_maps(in_picture(sample, sample.offset)),
        in_picture(sample, sample.mask).astype(bool),
    )
    expected = crop_maps(whole, Crop(np.diag([2.0, 2.0, 1.0]), 36))
    found_mask, found = in_picture(half, half.mask), fixed_point_to_maps(in_picture(half, half.pncc))
    # Where the surface jumps the two may copy different pixels of a block, and a mask of two in four goes either way.
    assert (found_mask != expected.mask).mean() < 0.02
    both = (found_mask > 0) & expected.mask
    far = np.abs(found - expected.pncc).max(axis=2)[both]
    assert np.median(far) <= 0.5 / 128 + 1e-6
    assert (far > 1.1 / 128).mean() < 0.1


def test_a_plane_is_halved_exactly_at_the_centres_of_the_new_pixels():
    rows, columns = np.mgrid[0:12, 0:16]
    pncc = np.stack([4 * columns, 8 * rows, np.full_like(rows, 1000)], axis=2)
    half = halved(sample_of(pncc, np.ones((12, 16), bool), (0, 0), (12, 16)))
    new_rows, new_columns = np.mgrid[0:6, 0:8]
    # The centre of new pixel j, in old pixels counted from the centre of the first: 2 j + 0.5.
    assert np.array_equal(half.pncc[..., 0], 4 * (2 * new_columns + 0.5))
    assert np.array_equal(half.pncc[..., 1], 8 * (2 * new_rows + 0.5))
    assert np.array_equal(half.offset, -half.pncc)


def test_pixels_outside_the_mask_do_not_count_and_three_of_four_are_enough():
    pncc = np.full((2, 6, 3), 900)
    mask = np.array([[1, 1, 1, 0, 0, 0], [1, 0, 1, 0, 1, 0]], bool)
    half = halved(sample_of(pncc, mask, (0, 0), (2, 6)))
    assert half.mask.tolist() == [[1, 0, 0]]
    assert half.pncc[0].tolist() == [[900] * 3, [0] * 3, [0] * 3]


def test_no_value_is_between_the_two_sides_of_a_fold():
    rng = np.random.default_rng(1)
    pncc = np.zeros((20, 20, 3))
    pncc[:, 9:] = 128 * 60  # 60 mm further, in the middle of a block
    pncc += rng.integers(0, 5, pncc.shape)
    half = halved(sample_of(pncc + 128, np.ones((20, 20), bool), (0, 0), (20, 20)))
    assert ((half.pncc < 128 + 5) | (half.pncc >= 128 * 61)).all()


def test_pictures_are_averaged_and_odd_edges_left_out():
    sample = sample_of(np.ones((3, 3, 3)), np.ones((3, 3), bool), (4, 4), (9, 11))
    half = halved(sample)
    assert half.image.shape == (4, 5, 3)
    blocks = sample.image[:8, :10].reshape(4, 2, 5, 2, 3).astype(float).mean(axis=(1, 3))
    assert np.abs(half.image - blocks).max() <= 0.5 + 1e-9
    assert half.landmarks2d.tolist() == [[1.5, 2.5], [4.0, 0.5]]
    assert half.corner == (2, 2)


def test_no_face_stays_none():
    half = halved(sample_of(np.zeros((0, 0, 3)), np.zeros((0, 0), bool), (0, 0), (8, 8)))
    assert half.mask.size == 0
    assert half.image.shape == (4, 4, 3)
