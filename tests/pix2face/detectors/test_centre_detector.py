"""The packaged kind of detector: scaling, decoding, and pictures that are no photographs."""

import tracemalloc
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy import ndarray
from skimage.data import astronaut

from pix2face.detectors.centre_decoding import decode
from pix2face.detectors.centre_detector import LARGEST_SIDE_PX, LONGEST_SIDE_PX, SURE_SCORE, TURNS_DEG, CentreDetector
from pix2face.detectors.protocol import Detector, overlap
from pix2face.geometry.crops import FaceBox
from pix2face.networks.dimensions import CENTRE_MULTIPLE, CENTRE_STRIDE

LONGEST_CANVAS_PX = -(-LONGEST_SIDE_PX // CENTRE_MULTIPLE) * CENTRE_MULTIPLE
ASTRONAUT = np.ascontiguousarray(astronaut()[:256, 94:350])


def white_things(pictures: ndarray) -> ndarray:
    """Answers as a network that takes white for a face: boxes of 4 by 6 cells at the cells that are white."""
    batch, height, width, _ = pictures.shape
    assert height % CENTRE_MULTIPLE == width % CENTRE_MULTIPLE == 0
    assert max(height, width) <= LARGEST_SIDE_PX
    cells = pictures.reshape(
        batch, height // CENTRE_STRIDE, CENTRE_STRIDE, width // CENTRE_STRIDE, CENTRE_STRIDE, 3
    ).mean(axis=(2, 4, 5))
    planes = np.zeros((*cells.shape, 5), dtype=np.float32)
    planes[..., 0] = (cells - 200) / 8
    planes[..., 3:] = np.log([4, 6])
    return planes


def seen_sizes(sizes: list[tuple[int, int]]) -> Callable[[ndarray], ndarray]:
    def answers(pictures: ndarray) -> ndarray:
        sizes.append(pictures.shape[1:3])
        return white_things(pictures)

    return answers


@pytest.mark.parametrize("factor", [1, 2, 5])
def test_boxes_are_in_the_pixels_of_the_picture(factor: int) -> None:
    picture = np.zeros((240 * factor, 320 * factor, 3), dtype=np.uint8)
    picture[80 * factor : 96 * factor, 160 * factor : 176 * factor] = 255
    detector = CentreDetector(white_things)
    assert isinstance(detector, Detector)
    (box,) = detector.detect(picture)
    np.testing.assert_allclose(box.centre, [168 * factor, 88 * factor], atol=4.5 * factor)
    assert (box.width, box.height) == pytest.approx((4 * CENTRE_STRIDE * factor, 6 * CENTRE_STRIDE * factor), rel=0.35)


@pytest.mark.parametrize("shape", [(1, 1), (1, 4000), (4000, 1), (7, 5), (2000, 3000)])
@pytest.mark.parametrize("fill", ["black", "grey", "noise"])
def test_pictures_of_any_size_cost_about_the_same(shape: tuple[int, int], fill: str) -> None:
    picture = {
        "black": np.zeros((*shape, 3), np.uint8),
        "grey": np.full((*shape, 3), 128, np.uint8),
        "noise": np.random.default_rng(0).integers(0, 256, (*shape, 3), dtype=np.uint8),
    }[fill]
    sizes: list[tuple[int, int]] = []
    assert CentreDetector(seen_sizes(sizes)).detect(picture) == []
    assert max(max(size) for size in sizes) <= LONGEST_CANVAS_PX


def test_smaller_faces_are_looked_for_in_a_finer_picture_at_bounded_cost() -> None:
    picture = np.zeros((1500, 2000, 3), dtype=np.uint8)
    sizes: list[tuple[int, int]] = []
    for smallest_face in (None, 0.5, 0.02, 1e-6):
        CentreDetector(seen_sizes(sizes), smallest_face).detect(picture)
    looks = 1 + len(TURNS_DEG)
    assert [max(size) for size in sizes[::looks]] == [LONGEST_CANVAS_PX, LONGEST_CANVAS_PX, 608, LARGEST_SIDE_PX]
    assert max(max(sizes[place]) for place in range(len(sizes)) if place % looks) <= 2 * LONGEST_CANVAS_PX


def test_three_hundred_people_on_one_picture() -> None:
    face = cv2.resize(ASTRONAUT[60:200, 60:200], (64, 64), interpolation=cv2.INTER_AREA)
    picture = np.tile(face, (15, 20, 1))
    n_found = len(CentreDetector.load(smallest_face=0.02).candidates(picture))
    assert 0 < n_found < 1000


@pytest.mark.parametrize("shape", [(20_000, 20_000), (1, 20_000), (20_000, 3)])
def test_a_huge_picture_is_not_copied(shape: tuple[int, int]) -> None:
    """Of 1.2 GB, were it in memory; only the pixels that are looked at are."""
    picture = np.broadcast_to(np.uint8([90, 120, 150]), (*shape, 3))
    tracemalloc.start()
    assert CentreDetector(white_things, smallest_face=0.01).detect(picture) == []
    most_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most_bytes < 300_000_000


def test_of_two_boxes_of_a_face_the_surer_one_stays() -> None:
    planes = np.zeros((16, 16, 5), dtype=np.float32)
    planes[..., 0] = -9
    planes[..., 3:] = np.log(8)
    planes[4, 4, 0], planes[4, 6, 0] = 3, 2  # overlap by 0.6
    planes[12, 12, 0] = 1
    planes[5, 2, 0], planes[5, 2, 3:] = 2.5, np.log(2)  # within the first
    boxes, scores = decode(planes, CENTRE_STRIDE, 0.1)
    np.testing.assert_allclose(scores, 1 / (1 + np.exp([-3.0, -1.0])))
    np.testing.assert_allclose((boxes[:, :2] + boxes[:, 2:]) / 2, [[36, 36], [100, 100]], atol=0.5)


def test_three_hundred_faces_are_found() -> None:
    planes = np.full((80, 80, 5), -9, dtype=np.float32)
    planes[..., 1:3], planes[..., 3:] = 0, np.log(2)
    places = np.argwhere(np.ones((20, 15))) * 4 + 2
    planes[places[:, 0], places[:, 1], 0] = 4
    assert len(decode(planes, CENTRE_STRIDE, 0.3)[0]) == 300


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_faces_of_turned_pictures_are_found_in_their_pixels(turns: int) -> None:
    picture = np.ascontiguousarray(astronaut()[:450, :380])
    (expected, *_) = CentreDetector.load().candidates(picture)
    (found, *_) = CentreDetector.load().candidates(np.ascontiguousarray(np.rot90(picture, turns)))
    corners = np.array([[expected.box.left, expected.box.top], [expected.box.right, expected.box.bottom]])
    width, height = picture.shape[1], picture.shape[0]
    for _ in range(turns):
        corners = np.column_stack([corners[:, 1], width - corners[:, 0]])
        width, height = height, width
    assert overlap(found.box, FaceBox.around(corners)) > 0.8
    assert (expected.box.turn_deg, found.box.turn_deg) == (0, 360 - 90 * turns)  # the face leans to the left


def one_in_the_middle(pictures: ndarray, score: float) -> ndarray:
    """Answers as a network that sees one face, of 48 px, in the middle of 240 px."""
    probability = score * SURE_SCORE
    planes = np.zeros((1, *(side // CENTRE_STRIDE for side in pictures.shape[1:3]), 5), dtype=np.float32)
    planes[..., 0] = -20
    planes[0, 14, 14] = np.log(probability / (1 - probability)), 0.5, 0.5, np.log(6), np.log(6)
    return planes


@pytest.mark.parametrize(("turned", "expected"), [(1.4, 1.2), (1.7, 1.2), (1.9, 1.9)])
def test_a_turned_face_in_the_place_of_an_upright_one_must_be_clearly_surer(turned: float, expected: float) -> None:
    scores = iter([1.2, *[turned] * len(TURNS_DEG)])
    detector = CentreDetector(lambda pictures: one_in_the_middle(pictures, next(scores)))
    (face,) = detector.candidates(np.zeros((240, 240, 3), dtype=np.uint8))
    assert face.score == pytest.approx(expected)


@pytest.mark.parametrize(("score", "looks"), [(1.7, 1 + len(TURNS_DEG)), (1.8, 1)])
def test_turned_pictures_are_searched_unless_an_upright_face_is_convincing(score: float, looks: int) -> None:
    pictures: list[ndarray] = []

    def answers(batch: ndarray) -> ndarray:
        pictures.append(batch)
        return one_in_the_middle(batch, score)

    CentreDetector(answers).candidates(np.zeros((240, 240, 3), dtype=np.uint8))
    assert len(pictures) == looks
