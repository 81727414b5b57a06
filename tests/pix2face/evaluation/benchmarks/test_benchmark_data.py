"""What is there is read, what is missing is named, and nothing at all says where to get it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.errors import InputFileError, ModelMismatchError, UsageError
from pix2face.evaluation.benchmarks.benchmark_data import YAW_BINS, wrap_angle_deg, yaw_bin
from pix2face.evaluation.benchmarks.benchmark_search import find_benchmark
from pix2face.evaluation.benchmarks.manifest import load_manifest
from pix2face.shards.shard_reader import ShardReader
from tests.pix2face.benchmark_files import (
    frontal_camera,
    landmarks_of,
    write_heldout,
    write_mat,
    write_photograph,
    write_pts,
)
from tests.synthetic_models import small_head_model

LANDMARKS = landmarks_of(small_head_model(), frontal_camera())


def find(split, data):
    return find_benchmark(load_manifest(split), data, small_head_model())


@pytest.mark.parametrize("folder", ["ibug", ".", "300w/ibug", "300W/ibug"])
def test_ibug_is_found_in_the_usual_places(tmp_path, folder):
    write_photograph(tmp_path / folder / "image_004_1.jpg")
    write_pts(tmp_path / folder / "image_004_1.pts", LANDMARKS)
    found = find("ibug", tmp_path)
    (item,) = found.items
    face = item.load()
    assert (face.name, face.group) == ("ibug/image_004_1.jpg", "ibug")
    assert face.image is None
    assert face.with_image().image.shape == (200, 200, 3)
    np.testing.assert_allclose(face.landmarks2d, LANDMARKS, atol=1e-6)
    assert len(found.missing) == 134
    assert found.missing[0] == "ibug/image_003_1.jpg"


def test_half_of_a_pair_is_missing_and_named(tmp_path):
    for name in ("image_003_1", "image_004_1", "image_005_1"):
        write_photograph(tmp_path / f"{name}.jpg")
        write_pts(tmp_path / f"{name}.pts", LANDMARKS)
    (tmp_path / "image_003_1.pts").unlink()
    (tmp_path / "image_004_1.jpg").unlink()
    found = find("ibug", tmp_path)
    assert [item.name for item in found.items] == ["ibug/image_005_1.jpg"]
    assert found.missing[:2] == (
        "ibug/image_003_1.jpg (no image_003_1.pts)",
        "ibug/image_004_1.jpg (no image_004_1.jpg)",
    )


def test_training_pictures_of_the_same_name_are_not_taken_for_test_pictures(tmp_path):
    for folder, seed in (("lfpw/testset", 1), ("lfpw", 2), ("lfpw/trainset", 3)):
        write_photograph(tmp_path / folder / "image_0001.png", seed)
        write_pts(tmp_path / folder / "image_0001.pts", LANDMARKS + seed)
    (item,) = find("300w-common", tmp_path).items
    np.testing.assert_allclose(item.load().landmarks2d, LANDMARKS + 1, atol=1e-6)


def test_aflw_is_read_with_yaw_and_half_pixel(tmp_path):
    names = ("image00002", "image00004", "image00006")
    for name, yaw_deg in zip(names, (-45, 360 + 75, 10), strict=True):
        write_photograph(tmp_path / f"{name}.jpg")
        write_mat(tmp_path / f"{name}.mat", LANDMARKS, yaw_deg)
    faces = [item.load() for item in find("aflw2000-3d", tmp_path).items]
    np.testing.assert_allclose([face.yaw_deg for face in faces], [-45, 75, 10], atol=1e-3)
    assert [face.group for face in faces] == [YAW_BINS[1], YAW_BINS[2], YAW_BINS[0]]
    assert [face.has_unusual_angle for face in faces] == [False, True, False]
    for face in faces:
        np.testing.assert_allclose(face.landmarks2d, LANDMARKS, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pt3d_68": np.full((3, 68), np.nan)}, "found 68 missing"),
        ({"Pose_Para": np.full((1, 7), np.nan)}, "finite"),
        ({"pt3d_68": np.zeros((3, 21))}, "68"),
    ],
)
def test_damaged_truth_is_refused_when_read(tmp_path, changes, message):
    write_photograph(tmp_path / "image00002.jpg")
    write_mat(tmp_path / "image00002.mat", LANDMARKS, 0, **changes)
    (item,) = find("aflw2000-3d", tmp_path).items
    with pytest.raises(InputFileError, match=message) as caught:
        item.load()
    assert "image00002.mat" in str(caught.value)


def test_truncated_mat_and_picture_are_refused_when_read(tmp_path):
    for name in ("image00002", "image00004"):
        write_photograph(tmp_path / f"{name}.jpg")
        write_mat(tmp_path / f"{name}.mat", LANDMARKS, 0)
    mat, picture = tmp_path / "image00002.mat", tmp_path / "image00004.jpg"
    mat.write_bytes(mat.read_bytes()[:1000])
    picture.write_bytes(b"")
    first, second = find("aflw2000-3d", tmp_path).items
    with pytest.raises(InputFileError, match=r"image00002\.mat"):
        first.load()
    with pytest.raises(InputFileError, match=r"image00004\.jpg"):
        second.load().with_image()
    picture.unlink()
    with pytest.raises(InputFileError, match=r"expected a picture at .*image00004\.jpg, found none"):
        second.load().with_image()


@pytest.mark.parametrize("split", ["ibug", "300w-full", "300vw", "aflw2000-3d", "menpo3d-tracking", "builtin-heldout"])
def test_without_data_the_message_says_where_it_is_to_be_had(tmp_path, split):
    manifest = load_manifest(split)
    with pytest.raises(UsageError, match="PIX2FACE_DATA") as nothing_said:
        find(split, None)
    with pytest.raises(UsageError, match="none of its faces complete") as empty:
        find(split, tmp_path)
    with pytest.raises(UsageError, match="no such folder") as absent:
        find(split, tmp_path / "absent")
    for caught in (nothing_said, empty, absent):
        assert manifest.obtain in str(caught.value)
        assert manifest.layout in str(caught.value)


def test_heldout_renders_bring_their_maps(tmp_path):
    write_heldout(tmp_path, small_head_model())
    found = find("builtin-heldout", tmp_path)
    assert found.missing == tuple(f"seed1000000/{index:07d}" for index in range(2, 100))
    faces = [item.load() for item in found.items]
    assert [face.name for face in faces] == ["seed1000000/0000000", "seed1000000/0000001"]
    assert faces[1].with_image().image.max() == 30
    assert abs(faces[0].yaw_deg) < 1e-6
    assert faces[0].group == YAW_BINS[0]
    assert faces[0].maps.mask.sum() == 80 * 80
    np.testing.assert_allclose(faces[0].landmarks2d, LANDMARKS, atol=1e-4)


def test_a_damaged_attribute_is_no_matter_where_nobody_asks_for_it(tmp_path, monkeypatch):
    def damaged(reader):
        raise InputFileError("damaged")

    write_heldout(tmp_path, small_head_model())
    monkeypatch.setattr(ShardReader, "attributes", damaged)
    model = small_head_model()
    plain = load_manifest("builtin-heldout")
    assert len(find_benchmark(plain, tmp_path, model).items) == 2
    found = find_benchmark(replace(plain, by=("skin.melanin",)), tmp_path, model)
    assert [own.reason for own in found.unreadable] == ["damaged"]


def write_reannotated(path, *landmarks2d):
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, np.stack([points.T + 0.5 for points in landmarks2d]))


def find_reannotated(data, reannotated=None):
    manifest = load_manifest("aflw2000-3d").with_truth("reannotated")
    return find_benchmark(manifest, data, small_head_model(), reannotated)


@pytest.mark.parametrize("place", ["dev_reannotated_pts68.npy", "dev/AFLW2000-3D-Reannotated.pts68.npy"])
def test_reannotated_landmarks_take_the_place_of_the_original_ones_by_sorted_name(tmp_path, place):
    for name in ("image00006", "image00004"):
        write_photograph(tmp_path / "dev" / f"{name}.jpg")
        write_mat(tmp_path / "dev" / f"{name}.mat", LANDMARKS, 40)
    write_reannotated(tmp_path / place, LANDMARKS + 4, LANDMARKS + 6)
    first, second = (item.load() for item in find_reannotated(tmp_path / "dev").items)
    assert (first.name, second.name) == ("aflw2000-3d/image00004.jpg", "aflw2000-3d/image00006.jpg")
    np.testing.assert_allclose(first.landmarks2d, LANDMARKS + 4, atol=1e-9)
    np.testing.assert_allclose(second.landmarks2d, LANDMARKS + 6, atol=1e-9)
    assert first.group == YAW_BINS[1]


def test_reannotated_landmarks_that_do_not_fit_are_refused(tmp_path):
    write_photograph(tmp_path / "image00004.jpg")
    write_mat(tmp_path / "image00004.mat", LANDMARKS, 0)
    with pytest.raises(UsageError, match=r"expected re-annotated landmarks .* found none; pass --reannotated"):
        find_reannotated(tmp_path)
    file = tmp_path / "other.npy"
    write_reannotated(file, LANDMARKS, LANDMARKS)
    with pytest.raises(UsageError, match=r"other\.npy: expected landmarks of all 2000 .* the 1 in .*, found 2"):
        find_reannotated(tmp_path, file)
    np.save(file, np.zeros((1, 68, 2)))
    with pytest.raises(UsageError, match=r"expected landmarks of shape \(n, 2, 68\), found shape \(1, 68, 2\)"):
        find_reannotated(tmp_path, file)
    file.write_bytes(b"\x93NUMPY")
    with pytest.raises(InputFileError, match=r"other\.npy: expected a \.npy file"):
        find_reannotated(tmp_path, file)
    write_reannotated(file, np.full((68, 2), np.nan))
    with pytest.raises(InputFileError, match="expected finite re-annotated landmarks"):
        find_reannotated(tmp_path, file).items[0].load()
    with pytest.raises(UsageError, match="expected --truth reannotated with it, found original"):
        find_benchmark(load_manifest("aflw2000-3d"), tmp_path, small_head_model(), file)


def test_truth_beside_a_picture_that_was_resized_is_refused(tmp_path):
    write_photograph(tmp_path / "image00002.jpg")
    write_mat(tmp_path / "image00002.mat", LANDMARKS, 0)
    (item,) = find("aflw2000-3d", tmp_path).items
    item.load()
    cv2.imwrite(str(tmp_path / "image00002.jpg"), np.zeros((150, 150, 3), np.uint8))
    with pytest.raises(InputFileError, match="was the picture resized"):
        item.load()
    (tmp_path / "image00002.jpg").write_bytes(b"damaged")
    item.load()  # where pictures are not looked at, it does not matter


def test_poses_that_cannot_be_trusted_are_left_out(tmp_path):
    poses = {"image00002": (10, 1e-3), "image00004": (120, 1e-3), "image00006": (10, -1e-3)}
    for name, (yaw_deg, scale) in poses.items():
        write_photograph(tmp_path / f"{name}.jpg")
        pose = np.array([[0, np.radians(yaw_deg), 0, 100, 100, 0, scale]], dtype=np.float32)
        # With a negative scale, these angles turn the face upside down.
        write_mat(tmp_path / f"{name}.mat", LANDMARKS if scale > 0 else 200 - LANDMARKS, 0, Pose_Para=pose)
    faces = [item.load() for item in find("aflw2000-3d", tmp_path).items]
    assert faces[0].pose.yaw_deg == pytest.approx(10, abs=1e-4)
    assert [face.pose for face in faces[1:]] == [None, None]


def test_shards_of_other_faces_are_refused(tmp_path):
    """Those of the training, above all."""
    write_heldout(tmp_path, small_head_model(), seed=0)
    with pytest.raises(
        UsageError, match=r"shard-00000\.h5: expected .*seed1000000/0000099.*, found seed0/0000000"
    ) as caught:
        find("builtin-heldout", tmp_path)
    assert "datagen sample --n 100 --seed 1000000" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_shards_of_another_model_are_refused_naming_both(tmp_path):
    write_heldout(tmp_path, small_head_model(), sha256="f" * 64)
    with pytest.raises(ModelMismatchError, match="ffffffffffff") as caught:
        find("builtin-heldout", tmp_path)
    assert small_head_model().sha256[:12] in str(caught.value)


def test_a_damaged_shard_is_listed_and_the_others_are_read(tmp_path):
    write_heldout(tmp_path, small_head_model())
    whole = tmp_path / "shard-00000.h5"
    (tmp_path / "shard-00001.h5").write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    found = find("builtin-heldout", tmp_path)
    assert len(found.items) == 2
    assert [shard.name for shard in found.unreadable] == ["shard-00001.h5"]


@given(st.floats(-2000, 2000))
def test_wrapped_angles_point_the_same_way(angle_deg):
    wrapped = wrap_angle_deg(angle_deg)
    assert -180 <= wrapped < 180
    assert np.cos(np.radians(wrapped)) == pytest.approx(np.cos(np.radians(angle_deg)), abs=1e-9)


def test_bins_include_their_upper_edge():
    assert [yaw_bin(yaw) for yaw in (0, -30, 30.1, 60, -60.1, 179)] == [YAW_BINS[i] for i in (0, 0, 1, 1, 2, 2)]


def test_the_photographs_at_hand(shared_dir):
    found = find("ibug", shared_dir / "data" / "300w")
    assert [item.name.removeprefix("ibug/") for item in found.items] == [
        "image_003_1.jpg",
        "image_004_1.jpg",
        "image_005_1.jpg",
        "image_006.jpg",
    ]
    assert found.missing[0] == "ibug/image_007.jpg (no image_007.pts)"
    assert len(found.missing) == 131
    of_dev = find("aflw2000-3d-dev", shared_dir / "data" / "aflw2000_3d" / "dev")
    assert not of_dev.missing
    faces = [item.load() for item in of_dev.items]
    assert [sum(face.group == group for face in faces) for group in YAW_BINS] == [265, 69, 66]
