"""Scenes: what is drawn lies where the boxes say, and the same number gives the same scene."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pix2face.errors import InputFileError, UsageError
from training.data.shard_index import index_shards
from training.detection.backgrounds import Backgrounds
from training.detection.decoys import Things, part_of_head, textured, without_face
from training.detection.people import PEOPLE_LAYERS, People, Person, halved
from training.detection.scenes import Scene, SceneMaker, _add_bars, _note_covered, _paste, _place


@pytest.fixture
def maker(people_dir: Path, backgrounds_dir: Path) -> SceneMaker:
    people = People(index_shards([people_dir], layers=PEOPLE_LAYERS))
    return SceneMaker(people, Backgrounds(backgrounds_dir), Things([]), 96, 0)


def white_square() -> Person:
    """A person who is a white square on black, with landmarks at its corners."""
    rgba = np.zeros((64, 80, 4), dtype=np.uint8)
    rgba[..., 3] = 255
    rgba[20:44, 30:54, :3] = 255
    corners = np.array([[30, 20], [54, 20], [54, 44], [30, 44]], dtype=np.float64)
    return Person(rgba, np.tile(corners, (17, 1)), is_seen=True, has_environment=False)


def test_a_scene_depends_on_its_number_alone(maker: SceneMaker) -> None:
    first = [maker.make(number) for number in range(6)]
    again = [maker.make(number) for number in reversed(range(6))][::-1]
    for own, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(own.image, other.image)
        np.testing.assert_array_equal(own.boxes, other.boxes)
    assert len({own.image.tobytes() for own in first}) == 6


def test_there_are_scenes_without_and_with_many_faces(maker: SceneMaker) -> None:
    counts = [len(maker.make(number).boxes) for number in range(60)]
    assert min(counts) == 0
    assert max(counts) >= 5
    assert 0.2 < np.mean(np.array(counts) == 1) < 0.6


@pytest.mark.parametrize("side_px", [12.0, 30.0, 120.0])
def test_what_is_pasted_lies_where_its_box_says(side_px: float) -> None:
    person = white_square()
    for seed in range(8):
        rng = np.random.default_rng(seed)
        matrix = _place(rng, person.landmarks2d, side_px, Scene(np.zeros((256, 256, 3), np.uint8)))
        landmarks = person.landmarks2d[:4] @ matrix[:, :2].T + matrix[:, 2]
        low, high = landmarks.min(axis=0), landmarks.max(axis=0)
        if low.min() < 2 or high.max() > 254:
            continue
        image = np.zeros((256, 256, 3), dtype=np.uint8)
        _paste(np.random.default_rng([1, seed]), image, person.rgba, matrix)
        rows, columns = np.nonzero(image[..., 1] > image.max() // 2)
        found = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        # The corner of a turned square is thin, and a square of a few pixels is soft.
        assert np.abs(found - [*low, *high]).max() < 1.5 + 0.04 * side_px


def test_faces_that_something_covers_are_not_counted() -> None:
    scene = Scene(
        np.zeros((64, 64, 3), np.uint8), [np.array([0.0, 0, 20, 20]), np.array([40.0, 40, 60, 60])], [True] * 2
    )
    covered = np.zeros((64, 64), dtype=np.uint8)
    covered[:14] = 255
    _note_covered(scene, covered)
    assert scene.is_counted == [False, True]


def test_faces_beyond_the_border_of_a_photograph_are_not_counted() -> None:
    for seed in range(20):
        boxes = [np.array([24.0, 24, 40, 40]), np.array([0.0, 0, 2, 2]), np.array([62.0, 62, 64, 64])]
        scene = Scene(np.full((64, 64, 3), 9, np.uint8), boxes, [True] * 3)
        _add_bars(np.random.default_rng(seed), scene)
        assert 0.03 < (scene.image == 0).mean() < 0.6
        for box, is_counted in zip(scene.boxes, scene.is_counted, strict=True):
            left, top, right, bottom = box.astype(int)
            assert is_counted == ((scene.image[top:bottom, left:right] == 0).mean() <= 0.45)


def test_a_face_that_is_painted_over_is_gone() -> None:
    person = white_square()
    painted = without_face(np.random.default_rng(0), person.rgba, person)
    inside = painted[26:38, 36:48, :3].astype(int)
    assert np.ptp(inside.mean(axis=2)) < 90
    np.testing.assert_array_equal(painted[..., 3], person.rgba[..., 3])


def test_a_part_of_a_head_shows_little_of_the_face() -> None:
    """The face is a white square of 24 px on black: a part has white in at most the share that is allowed."""
    parts = [part_of_head(np.random.default_rng(seed), white_square()) for seed in range(40)]
    shares = [float((part[..., 0] > 0).mean()) for part in parts if part is not None]
    assert len(shares) > 30
    assert max(shares) <= 0.3
    assert max(shares) > 0.1


def test_things_are_pasted_as_they_are_cut_out(
    people_dir: Path, backgrounds_dir: Path, tmp_path: Path, maker: SceneMaker
) -> None:
    """A red disc on transparent ground, with a transparent margin and 16 bits a channel; scenes then show it."""
    disc = np.zeros((64, 48, 4), dtype=np.uint16)
    disc[20:40, 10:30] = [0, 0, 65535, 65535]  # blue, green, red, alpha
    cv2.imwrite(str(tmp_path / "disc.png"), disc)
    things = Things([tmp_path])
    thing = things.draw(np.random.default_rng(0))
    assert thing.shape == (20, 20, 4)
    np.testing.assert_array_equal(thing[10, 10], [255, 0, 0, 255])
    changed = textured(np.random.default_rng(1), thing, np.full((20, 20, 3), 50, np.uint8))
    np.testing.assert_array_equal(changed[..., 3], thing[..., 3])
    people = People(index_shards([people_dir], layers=PEOPLE_LAYERS))
    other = SceneMaker(people, Backgrounds(backgrounds_dir), things, 96, 0)
    assert any((other.make(number).image != maker.make(number).image).any() for number in range(4))


@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3)])
def test_things_without_transparency_are_whole_rectangles(tmp_path: Path, shape: tuple[int, ...]) -> None:
    cv2.imwrite(str(tmp_path / "flat.png"), np.full(shape, 90, dtype=np.uint8))
    thing = Things([tmp_path]).draw(np.random.default_rng(0))
    np.testing.assert_array_equal(thing, np.array([90, 90, 90, 255], np.uint8) + np.zeros((5, 7, 1), np.uint8))


def test_folders_and_files_without_things_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="expected PNG files of things, found none"):
        Things([tmp_path])
    (tmp_path / "text.png").write_text("text")
    with pytest.raises(InputFileError, match=r"text\.png"):
        Things([tmp_path]).draw(np.random.default_rng(0))


def test_large_pictures_are_halved_before_they_are_drawn_small() -> None:
    rgba = np.zeros((200, 100, 4), dtype=np.uint8)
    small, divided = halved(rgba, 0.1)
    assert (small.shape, divided) == ((25, 12, 4), 8.0)
    assert halved(rgba, 0.7)[1] == 1


def test_a_folder_without_pictures_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="expected pictures that show nobody, found none; `datagen empty` draws some"):
        Backgrounds(tmp_path)
