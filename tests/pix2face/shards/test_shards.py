"""The shard format: what goes in comes out, whatever the layers, sizes and compression."""

import zlib
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from pix2face.errors import InputFileError, UsageError
from pix2face.shards.layers import LAYERS
from pix2face.shards.sample import Sample
from pix2face.shards.shard_checks import verify_shard
from pix2face.shards.shard_reader import ShardHeader, ShardReader, shard_paths
from pix2face.shards.shard_writing import write_shard
from tests.pix2face.shard_files import HEADER, as_earlier_versions_stored, every_layer, make_triplet, stored_layer

COMPRESSIONS = ("coded", "plain", "schema 2", "schema 2 plain", "schema 2 zstd")


def write(path: Path, header: ShardHeader, samples: list[Sample], compression: str) -> None:
    """In today's ways, or as earlier versions could."""
    write_shard(path, header, samples, is_plain=compression == "plain")
    if compression.startswith("schema 2"):
        as_earlier_versions_stored(path, compression.removeprefix("schema 2 "))


@pytest.fixture
def shard(tmp_path: Path) -> Path:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, HEADER, [make_triplet(seed) for seed in range(4)])
    return path


def test_what_is_written_is_read_back_within_half_a_step(shard: Path) -> None:
    reader = ShardReader(shard)
    assert reader.header == HEADER
    assert reader.sample_ids == [f"face/{seed}" for seed in range(4)]
    for index in range(4):
        expected, found = make_triplet(index), reader.read(index)
        assert np.abs(found.maps.pncc - expected.maps.pncc).max() <= 0.5 / 128 + 1e-5
        assert np.abs(found.maps.offset - expected.maps.offset).max() <= 0.5 / 128 + 1e-5
        assert np.abs(found.layers["depth"] - expected.layers["depth"]).max() <= 0.5 / 128 + 1e-4
        np.testing.assert_array_equal(found.maps.mask, expected.maps.mask)
        np.testing.assert_array_equal(found.camera.matrix, expected.camera.matrix)
        np.testing.assert_array_equal(found.visible, expected.visible)
        np.testing.assert_allclose(found.landmarks2d, expected.landmarks2d, atol=1e-4)
        assert found.attributes == expected.attributes
        assert found.image_bytes == expected.image_bytes
        assert reader.column("offset_limit_mm")[index] == np.abs(found.maps.offset).max()


def test_same_samples_give_the_same_bytes(tmp_path: Path) -> None:
    first, second = tmp_path / "a" / "shard-00000.h5", tmp_path / "b" / "shard-00000.h5"
    for path in (first, second):
        write_shard(path, HEADER, [make_triplet(0)])
    assert first.read_bytes() == second.read_bytes()


def test_pictures_of_several_sizes_share_a_shard(tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, HEADER, [make_triplet(0, 24), make_triplet(1, 40), make_triplet(2, 31)])
    reader = ShardReader(path)
    for index, size in enumerate((24, 40, 31)):
        assert reader.read(index).image.shape == (size, size, 3)
        np.testing.assert_array_equal(reader.read(index).maps.mask, make_triplet(index, size).maps.mask)


def test_a_shard_may_be_empty(tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, HEADER, [])
    reader = ShardReader(path)
    assert len(reader) == 0
    assert verify_shard(path) == []


def test_foreign_and_newer_files_are_refused(shard: Path, tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.h5"
    with h5py.File(foreign, "w") as file:
        file["x"] = np.zeros(3)
    with pytest.raises(InputFileError, match="expected a shard"):
        ShardReader(foreign)
    with h5py.File(shard, "r+") as file:
        file.attrs["schema_version"] = 99
    with pytest.raises(InputFileError, match="newer than 3"):
        ShardReader(shard)
    with h5py.File(shard, "r+") as file:
        file.attrs["schema_version"] = 1
    with pytest.raises(
        InputFileError,
        match="expected shard schema 2 or 3, found 1, made by an earlier version; delete the folder and run",
    ):
        ShardReader(shard)


def test_shards_of_the_first_schema_are_known_by_their_text_of_variable_length(tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["schema_version"] = "pix2face-shard", 1
        file["offset_limit_mm"] = np.zeros(3)
    with pytest.raises(InputFileError, match="found 1, made by an earlier version"):
        ShardReader(path)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_every_layer_comes_back_from_every_compression(tmp_path: Path, compression: str) -> None:
    header, triplets = every_layer(3)
    path = tmp_path / "shard-00000.h5"
    write(path, header, triplets, compression)
    assert verify_shard(path) == []
    reader = ShardReader(path)
    for index, expected in enumerate(triplets):
        for name, layer in LAYERS.items():
            found = reader.read(index, [name]).layers[name]
            assert found.dtype == expected.layers[name].dtype
            error = np.abs(found.astype(np.float64) - expected.layers[name])
            assert error.max() <= 0.5 / layer.steps_per_unit + 1e-4
            np.testing.assert_array_equal(found[error == error], reader.read(index).layers[name].ravel())
        cut, maps = reader.stored(index, ("pncc", "mask", "box_px"), is_checked=True), reader.read(index).maps
        top, left, bottom, right = cut["box_px"]
        np.testing.assert_array_equal(cut["pncc"] / np.float32(128), maps.pncc[top:bottom, left:right])
        np.testing.assert_array_equal(cut["mask"], maps.mask[top:bottom, left:right])
        assert maps.mask.sum() == cut["mask"].sum()


def test_samples_have_the_same_checksum_however_they_are_stored(tmp_path: Path) -> None:
    header, triplets = every_layer(2)
    found = []
    write_shard(tmp_path / "shard-00000.h5", header, triplets)
    found.append(ShardReader(tmp_path / "shard-00000.h5").column("checksum").tolist())
    write_shard(tmp_path / "shard-00000.h5", header, [*triplets, make_larger(triplets[0])])  # padded to the largest
    found.append(ShardReader(tmp_path / "shard-00000.h5").column("checksum").tolist()[:2])
    assert len({tuple(checksums) for checksums in found}) == 1


def make_larger(triplet: Sample) -> Sample:
    layers = {name: np.concatenate([values, values[-1:]]) for name, values in triplet.layers.items()}
    return replace(triplet, sample_id="larger", layers=layers)


def test_the_checksum_is_that_of_zlib_over_the_content_as_documented(shard: Path) -> None:
    reader = ShardReader(shard)
    with h5py.File(shard) as file:
        found = 0
        for name in ("pncc", "offset", "mask", "depth"):
            found = zlib.crc32(stored_layer(reader, 1, name).tobytes(), found)
        found = zlib.crc32(reader.read(1).image_bytes, found)
        for name in ("camera", "identity", "expression", "landmarks2d", "landmarks3d", "visible"):
            found = zlib.crc32(file[name][1].tobytes(), found)
        found = zlib.crc32(file["attributes"][1], found)
        assert file["checksum"][1] == found


def test_what_is_coded_has_another_name_and_plain_values_are_true(tmp_path: Path) -> None:
    header, triplets = every_layer(2)
    coded, plain = tmp_path / "shard-00000.h5", tmp_path / "shard-00001.h5"
    write_shard(coded, header, triplets)
    write_shard(plain, header, [triplets[0], make_larger(triplets[1])], is_plain=True)  # one of them is padded
    with h5py.File(coded) as file:
        for name, layer in LAYERS.items():
            assert (f"{name}_coded" in file, name in file) == (layer.is_smooth, not layer.is_smooth)
    reader = ShardReader(coded)
    with h5py.File(plain) as file:
        assert not any(name.endswith("_coded") for name in file)
        for name, layer in LAYERS.items():
            expected = reader.read(0).layers[name]
            assert file[name].attrs["predictor"] == b"none"
            values = file[name][0, : expected.shape[0], : expected.shape[1]] / file[name].attrs["steps_per_unit"]
            np.testing.assert_allclose(values, expected, rtol=0 if layer.is_smooth else 1e-6)
            assert layer.is_smooth <= (file[name].dtype == np.float32)
    for index in range(2):
        ShardReader(plain).stored(index, ("pncc",), is_checked=True)


def test_a_coded_layer_under_another_name_is_refused(shard: Path) -> None:
    with h5py.File(shard, "r+") as file:
        file["pncc"] = file["pncc_coded"]
        del file["pncc_coded"]
    with pytest.raises(InputFileError, match="the predictor of /pncc is not the one that its name says"):
        ShardReader(shard)


def test_a_file_of_schema_2_is_read() -> None:
    """It was written by the last version that wrote this schema."""
    path = Path(__file__).with_name("schema_2.h5")
    assert verify_shard(path) == []
    header, triplets = every_layer(2)
    reader = ShardReader(path)
    assert not reader.is_current
    assert reader.header == replace(header, rejected='[["face/9", "no picture"]]')
    for index, expected in enumerate(triplets):
        assert reader.read(index).image_bytes == expected.image_bytes
        np.testing.assert_allclose(reader.read(index).maps.pncc, expected.maps.pncc, atol=0.5 / 128 + 1e-5)


def test_only_layers_that_were_asked_for_are_stored(tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, replace(HEADER, layers=("mask",)), [make_triplet(0)])
    with h5py.File(path) as file:
        assert not {"pncc", "pncc_coded", "image", "image_length"} & set(file)
        assert file["landmarks2d"].shape == (1, 0, 2)
    assert verify_shard(path) == []
    reader = ShardReader(path)
    triplet = reader.read(0)
    assert triplet.image_bytes is None
    assert set(triplet.layers) == {"mask"}
    assert triplet.landmarks3d.shape == (0, 3)
    with pytest.raises(UsageError, match=r"face/0: expected the layers pncc,offset,mask, found no pncc"):
        triplet.maps  # noqa: B018
    with pytest.raises(UsageError, match="expected the layer depth, found mask; render with --layers"):
        reader.read(0, ["depth"])
    with pytest.raises(UsageError, match="expected a picture, found layers mask;"):
        reader.read(0).image  # noqa: B018


def test_pictures_alone_make_a_shard(tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, replace(HEADER, layers=("image", "landmarks")), [make_triplet(seed) for seed in range(3)])
    assert verify_shard(path) == []
    reader = ShardReader(path)
    assert reader.read(2).image.shape == (24, 24, 3)
    assert reader.read(1, ()).landmarks2d.shape == (68, 2)


def test_chunks_without_their_filters_are_read(tmp_path: Path) -> None:
    """HDF5 allows a chunk to leave out filters that would not shrink it."""
    path = tmp_path / "shard-00000.h5"
    write_shard(path, HEADER, [make_triplet(0)])
    reader = ShardReader(path)
    expected = stored_layer(reader, 0, "pncc")
    with h5py.File(path, "r+") as file:
        for name in ("pncc_coded", "image"):
            unfiltered = file[name][0].tobytes()
            file[name].id.write_direct_chunk((0,) * file[name].ndim, unfiltered, filter_mask=3)
    reader = ShardReader(path)
    np.testing.assert_array_equal(stored_layer(reader, 0, "pncc"), expected)
    assert verify_shard(path) == []


def test_nothing_has_a_variable_length(shard: Path) -> None:
    """Damaged, it could end the process inside the HDF5 library."""
    with h5py.File(shard) as file:
        assert all(item.dtype.kind != "O" for item in file.values())
        assert all(file.attrs.get_id(name).dtype.kind != "O" for name in file.attrs)


def test_a_folder_without_shards_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="datagen render"):
        shard_paths(tmp_path)
    with pytest.raises(UsageError, match="no such folder"):
        shard_paths(tmp_path / "nothing")
    table = tmp_path / "faces.h5"
    table.touch()
    with pytest.raises(UsageError, match=r"faces\.h5: expected a folder of shards .*, found a file$"):
        shard_paths(table)
