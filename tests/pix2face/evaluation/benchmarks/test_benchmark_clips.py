"""Clips as folders of pictures and as videos, with 68 and 84 points, in the plane and in space."""

import cv2
import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.evaluation.benchmarks.benchmark_search import find_benchmark
from pix2face.evaluation.benchmarks.manifest import load_manifest
from tests.pix2face.benchmark_files import frontal_camera, landmarks_of, write_photograph, write_points, write_pts
from tests.synthetic_models import small_head_model

LANDMARKS = landmarks_of(small_head_model(), frontal_camera())


def find(split, data):
    return find_benchmark(load_manifest(split), data, small_head_model())


def write_video(path, n_frames):
    """Frames of even grey, 20 brighter each."""
    path.parent.mkdir(parents=True, exist_ok=True)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, (64, 48))
    for index in range(n_frames):
        video.write(np.full((48, 64, 3), 20 + 20 * index, dtype=np.uint8))
    video.release()


@pytest.mark.parametrize("home", [".", "300VW_Dataset_2015_12_14"])
def test_frames_come_from_pictures_in_the_scenario_of_their_clip(tmp_path, home):
    for clip in ("401", "001"):
        for frame in ("000007", "000003"):
            write_photograph(tmp_path / home / clip / "imgs" / f"{frame}.jpg")
            write_pts(tmp_path / home / clip / "annot" / f"{frame}.pts", LANDMARKS)
    (tmp_path / home / "401" / "imgs" / "000007.jpg").unlink()
    found = find("300vw", tmp_path)
    faces = [item.load() for item in found.items]
    assert [(face.name, face.group, face.clip) for face in faces] == [
        ("001/000003", "training", "001"),
        ("001/000007", "training", "001"),
        ("401/000003", "cat. 1", "401"),
    ]
    np.testing.assert_allclose(faces[0].landmarks2d, LANDMARKS, atol=1e-6)
    assert faces[0].with_image().image.shape == (200, 200, 3)
    assert "401/000007 (no picture, no vid.avi)" in found.missing
    assert sum(len(name) == 3 for name in found.missing) == 63


def test_frames_come_from_a_video_in_any_order(tmp_path):
    write_video(tmp_path / "114" / "vid.avi", 4)
    for frame in (1, 2, 4, 9):
        write_pts(tmp_path / "114" / "annot" / f"{frame:06d}.pts", LANDMARKS)
    first, second, fourth, beyond = (item.load() for item in find("300vw", tmp_path).items)
    greys = [face.with_image().image.mean() for face in (second, fourth, first, second)]
    np.testing.assert_allclose(greys, [40, 80, 20, 40], atol=2)
    with pytest.raises(InputFileError, match=r"vid\.avi: expected a frame 9, found 4 that can be read"):
        beyond.with_image()
    np.testing.assert_allclose(first.with_image().image.mean(), 20, atol=2)


def test_frames_of_several_videos_do_not_mix(tmp_path):
    for clip, n_frames in (("114", 2), ("124", 4)):
        write_video(tmp_path / clip / "vid.avi", n_frames)
        write_pts(tmp_path / clip / "annot" / "000002.pts", LANDMARKS)
        write_pts(tmp_path / clip / "annot" / f"{n_frames:06d}.pts", LANDMARKS)
    first, second, last = (item.load() for item in find("300vw", tmp_path).items)
    greys = [face.with_image().image.mean() for face in (first, last, first, second, last, second)]
    np.testing.assert_allclose(greys, [40, 80, 40, 40, 80, 40], atol=2)


def test_a_text_in_place_of_a_video_is_refused_when_read(tmp_path, capfd):
    write_pts(tmp_path / "114" / "annot" / "000001.pts", LANDMARKS)
    (tmp_path / "114" / "vid.avi").write_text("no video")
    (item,) = find("300vw", tmp_path).items
    with pytest.raises(InputFileError, match=r"vid\.avi: expected a frame 1, found 0"):
        item.load().with_image()


def write_menpo(folder, n_points=84):
    """The 68 landmarks among 84 points whose others are nonsense."""
    manifest = load_manifest("menpo3d-tracking")
    chosen = list(manifest.landmark_indices) if n_points == 84 else list(range(68))
    points, in_space = np.full((n_points, 2), 1e4), np.full((n_points, 3), 1e4)
    points[chosen] = LANDMARKS
    in_space[chosen] = np.column_stack([LANDMARKS, np.arange(68)])
    write_pts(folder / "annot" / "000001.pts", points)
    write_points(folder / "annot3d" / "000001.pts", in_space)
    write_photograph(folder / "imgs" / "000001.jpg")
    return in_space[chosen]


@pytest.mark.parametrize("n_points", [84, 68])
def test_the_68_are_taken_from_menpos_84_points(tmp_path, n_points):
    in_space = write_menpo(tmp_path / "some clip", n_points)
    (item,) = find("menpo3d-tracking", tmp_path).items
    face = item.load()
    assert (face.name, face.group, face.clip) == ("some clip/000001", "clips", "some clip")
    np.testing.assert_allclose(face.landmarks2d, LANDMARKS, atol=1e-6)
    np.testing.assert_allclose(face.landmarks3d, in_space, atol=1e-6)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((70, 3)), r"expected 84 or 68 points of three numbers, found 210 numbers"),
        (np.zeros((68, 2)), r"found 136 numbers"),
        (np.full((68, 3), np.nan), r"finite"),
    ],
)
def test_points_in_space_of_another_number_are_refused(tmp_path, points, message):
    write_menpo(tmp_path / "clip")
    write_points(tmp_path / "clip" / "annot3d" / "000001.pts", points)
    (item,) = find("menpo3d-tracking", tmp_path).items
    with pytest.raises(InputFileError, match=message) as caught:
        item.load()
    assert "000001.pts" in str(caught.value)


def test_points_of_another_number_are_refused(tmp_path):
    write_menpo(tmp_path / "clip")
    write_pts(tmp_path / "clip" / "annot" / "000001.pts", np.zeros((66, 2)))
    (item,) = find("menpo3d-tracking", tmp_path).items
    with pytest.raises(InputFileError, match=r"000001\.pts"):
        item.load()
    write_menpo(tmp_path / "clip")
    (tmp_path / "clip" / "annot3d" / "000001.pts").write_text("{ 1 2 x }")
    with pytest.raises(InputFileError, match="three numbers a line"):
        item.load()


def test_an_annotation_that_cannot_be_read_is_the_error_of_its_frame(tmp_path):
    write_menpo(tmp_path / "clip")
    annotation = tmp_path / "clip" / "annot" / "000001.pts"
    annotation.unlink()
    annotation.mkdir()
    (item,) = find("menpo3d-tracking", tmp_path).items
    with pytest.raises(InputFileError, match=r"000001\.pts: expected the text of a \.pts annotation, found a folder"):
        item.load()


def test_the_clips_at_hand(shared_dir):
    found = find("300vw", shared_dir / "data" / "300vw")
    assert [item.name for item in found.items] == ["001/000006", "001/000009", "401/000731", "401/000732"]
    for item in found.items:
        assert item.load().with_image().image.ndim == 3
