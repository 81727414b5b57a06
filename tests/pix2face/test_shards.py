"""The shard format: what goes in comes out, and damage is noticed."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from pix2face.camera import Camera
from pix2face.errors import InputFileError, UsageError
from pix2face.images import encode_image
from pix2face.layers import DEFAULT_LAYERS
from pix2face.shard_checks import verify_shard
from pix2face.shard_writing import write_shard
from pix2face.shards import ShardHeader, ShardReader, Triplet, shard_paths

HEADER = ShardHeader(
    model_name="synthetic",
    model_sha256="0" * 64,
    pncc_limit_mm=120.0,
    smallest_radius_mm=60.0,
    licence="CC0-1.0",
    configuration="{}",
    generator="test",
    layers=(*DEFAULT_LAYERS, "depth"),
)


def make_triplet(seed: int, size: int = 24) -> Triplet:
    rng = np.random.default_rng(seed)
    mask = np.zeros((size, size), dtype=bool)
    mask[4:-4, 6:-5] = True
    pncc = (rng.uniform(-119, 119, (size, size, 3)) * mask[..., None]).astype(np.float32)
    offset = (rng.normal(0, 5, (size, size, 3)) * mask[..., None]).astype(np.float32)
    return Triplet(
        sample_id=f"face/{seed}",
        image=encode_image(rng.integers(0, 256, (size, size, 3), dtype=np.uint8)),
        layers={
            "pncc": pncc,
            "offset": offset,
            "mask": mask,
            "depth": (rng.uniform(300, 400, (size, size)) * mask).astype(np.float32),
        },
        camera=Camera(rng.normal(size=(4, 4))),
        identity=rng.normal(size=5),
        expression=rng.normal(size=3),
        landmarks2d=rng.uniform(0, size, (68, 2)),
        landmarks3d=rng.normal(0, 50, (68, 3)),
        visible=rng.random(68) > 0.5,
        attributes={"source": "test", "yaw_deg": 12.5},
    )


@pytest.fixture
def shard(tmp_path: Path) -> Path:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, HEADER, [make_triplet(seed) for seed in range(4)])
    return path


def test_what_is_written_is_read_back_within_half_a_step(shard: Path) -> None:
    with ShardReader(shard) as reader:
        assert reader.header == HEADER
        assert reader.sample_ids == [f"face/{seed}" for seed in range(4)]
        for index in range(4):
            expected, found = make_triplet(index), reader.triplet(index)
            assert np.abs(found.maps.pncc - expected.maps.pncc).max() <= 0.5 / 128 + 1e-5
            assert np.abs(found.maps.offset - expected.maps.offset).max() <= 0.5 / 128 + 1e-5
            assert np.abs(found.layers["depth"] - expected.layers["depth"]).max() <= 0.5 / 128 + 1e-4
            np.testing.assert_array_equal(found.maps.mask, expected.maps.mask)
            np.testing.assert_array_equal(found.camera.matrix, expected.camera.matrix)
            np.testing.assert_array_equal(found.visible, expected.visible)
            np.testing.assert_allclose(found.landmarks2d, expected.landmarks2d, atol=1e-4)
            assert found.attributes == expected.attributes
            assert found.image == expected.image
            assert reader.offset_limits_mm[index] == np.abs(found.maps.offset).max()


def test_same_samples_give_the_same_bytes(tmp_path: Path) -> None:
    first, second = tmp_path / "a" / "shard-00000.h5", tmp_path / "b" / "shard-00000.h5"
    for path in (first, second):
        write_shard(path, HEADER, [make_triplet(0)])
    assert first.read_bytes() == second.read_bytes()


def test_pictures_of_several_sizes_share_a_shard(tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, HEADER, [make_triplet(0, 24), make_triplet(1, 40), make_triplet(2, 31)])
    with ShardReader(path) as reader:
        for index, size in enumerate((24, 40, 31)):
            assert reader.image(index).shape == (size, size, 3)
            np.testing.assert_array_equal(reader.maps(index).mask, make_triplet(index, size).maps.mask)


def test_a_shard_may_be_empty(tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, HEADER, [])
    with ShardReader(path) as reader:
        assert len(reader) == 0
    assert verify_shard(path) == []


def test_an_error_leaves_neither_shard_nor_temporary_file(tmp_path: Path) -> None:
    bad = make_triplet(0)
    bad.maps.pncc[10, 10] = 300
    with pytest.raises(InputFileError, match=r"pncc within ±255\.9 mm"):
        write_shard(tmp_path / "shard-00000.h5", HEADER, [bad])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_shard_is_refused_with_one_clear_line(shard: Path, fraction: float) -> None:
    content = shard.read_bytes()
    shard.write_bytes(content[: int(len(content) * fraction)])
    problems = verify_shard(shard)
    assert problems
    assert str(shard) in problems[0]
    assert "\n" not in problems[0]


def test_verify_notices_a_changed_value(shard: Path) -> None:
    with h5py.File(shard, "r+") as file:
        file["landmarks2d"][2, 10] += 1
    assert verify_shard(shard) == [
        "sample 'face/2': the checksum differs: the content has changed since it was written"
    ]


def test_verify_notices_values_outside_the_mask(shard: Path) -> None:
    with h5py.File(shard, "r+") as file:
        file["pncc"][1, 0, 0] = 5
    assert any("pncc is not 0 outside the mask" in problem for problem in verify_shard(shard))


def test_verify_notices_duplicate_ids(tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    with pytest.raises(InputFileError, match="sample ids are not unique"):
        write_shard(path, HEADER, [make_triplet(0), make_triplet(0)])


def test_foreign_and_newer_files_are_refused(shard: Path, tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.h5"
    with h5py.File(foreign, "w") as file:
        file["x"] = np.zeros(3)
    with pytest.raises(InputFileError, match="expected a shard"):
        ShardReader(foreign)
    with h5py.File(shard, "r+") as file:
        file.attrs["schema_version"] = 99
    with pytest.raises(InputFileError, match="newer than 2"):
        ShardReader(shard)


def test_a_folder_without_shards_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="datagen render"):
        shard_paths(tmp_path)
    with pytest.raises(UsageError, match="no such folder"):
        shard_paths(tmp_path / "nothing")
