"""The data set for other people's trainers: a sequence, the same in every process, with errors that say what to do."""

import multiprocessing
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pix2face.shards
from pix2face.errors import InputFileError, ModelMismatchError, UsageError
from pix2face.shards import Sample, ShardDataset
from pix2face.shards.shard_writing import write_shard
from tests.pix2face.shard_files import HEADER, make_triplet


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three shards of three, no and two samples."""
    for number, seeds in enumerate(((0, 1, 2), (), (3, 4))):
        write_shard(tmp_path / "s" / f"shard-{number:05d}.h5", HEADER, [make_triplet(seed) for seed in seeds])
    return tmp_path / "s"


def fingerprint(sample: Sample) -> tuple[str, bytes, bytes]:
    return sample.sample_id, sample.image.tobytes(), sample.layers["pncc"].tobytes()


def test_it_is_a_sequence(folder: Path) -> None:
    dataset = ShardDataset(folder)
    names = [f"face/{seed}" for seed in range(5)]
    assert len(dataset) == 5
    assert [sample.sample_id for sample in dataset] == names
    assert [dataset[index].sample_id for index in (4, 0, 3, -1, np.int64(-5))] == [
        "face/4", "face/0", "face/3", "face/4", "face/0"
    ]  # fmt: skip
    assert [sample.sample_id for sample in reversed(dataset)] == names[::-1]
    for index in (5, -6):
        with pytest.raises(IndexError, match=f"expected an index of 5 samples, found {index}"):
            dataset[index]
    with pytest.raises(TypeError, match="found a slice"):
        dataset[1:3]
    with pytest.raises(TypeError):
        dataset["face/0"]  # type: ignore[call-overload]


def test_an_item_has_what_was_written_in_the_documented_types(folder: Path) -> None:
    sample, expected = ShardDataset(str(folder))[3], make_triplet(3)
    for values, dtype, shape in (
        (sample.image, np.uint8, (24, 24, 3)),
        (sample.layers["pncc"], np.float32, (24, 24, 3)),
        (sample.layers["offset"], np.float32, (24, 24, 3)),
        (sample.layers["mask"], np.bool_, (24, 24)),
        (sample.layers["depth"], np.float32, (24, 24)),
        (sample.landmarks2d, np.float32, (68, 2)),
        (sample.landmarks3d, np.float32, (68, 3)),
        (sample.visible, np.bool_, (68,)),
        (sample.identity, np.float32, (5,)),
        (sample.expression, np.float32, (3,)),
    ):
        assert (values.dtype, values.shape) == (dtype, shape)
        assert values.flags.writeable  # torch.from_numpy warns of others
    np.testing.assert_array_equal(sample.image, expected.image)
    assert np.abs(sample.layers["pncc"] - expected.layers["pncc"]).max() <= 0.5 / 128 + 1e-5
    np.testing.assert_array_equal(sample.camera.matrix, expected.camera.matrix)
    assert sample.attributes == {"source": "test", "yaw_deg": 12.5}


def test_layers_are_chosen_and_files_may_be_named(folder: Path) -> None:
    dataset = ShardDataset([folder / "shard-00002.h5", str(folder / "shard-00000.h5")], layers=("mask", "pncc"))
    assert dataset.layers == ("pncc", "mask")
    assert [sample.sample_id for sample in dataset] == ["face/3", "face/4", "face/0", "face/1", "face/2"]
    assert (set(dataset[0].layers), dataset[0].image_bytes) == ({"pncc", "mask"}, None)
    with pytest.raises(UsageError, match=r"shard-00002\.h5, sample 0: expected a picture, found layers pncc,mask"):
        _ = dataset[0].image


@pytest.mark.parametrize("method", ["fork", "spawn"])
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_other_processes_read_the_same(folder: Path, method: str) -> None:
    """Also where the parent has read before: no handle and no file position is shared."""
    dataset = ShardDataset(folder)
    expected = [fingerprint(dataset[index]) for index in range(5)]
    with multiprocessing.get_context(method).Pool(2) as pool:
        found = pool.starmap(read, [(dataset, index) for index in range(5)] * 3, chunksize=1)
    assert found == expected * 3


def read(dataset: ShardDataset, index: int) -> tuple[str, bytes, bytes]:
    return fingerprint(dataset[index])


def test_data_sets_and_samples_are_pickled(folder: Path) -> None:
    dataset = ShardDataset(folder)
    copy = pickle.loads(pickle.dumps(dataset))
    assert fingerprint(copy[4]) == fingerprint(dataset[4])
    assert fingerprint(pickle.loads(pickle.dumps(dataset[4]))) == fingerprint(dataset[4])
    assert len(pickle.dumps(dataset)) < 10_000


def test_the_table_of_layers_loads_no_hdf5_and_samples_no_torch(folder: Path) -> None:
    code = f"""
import sys, pix2face.shards, pix2face.shards.layers
print("h5py" in sys.modules)
pix2face.shards.ShardDataset({str(folder)!r})[0].image
print("h5py" in sys.modules, "torch" in sys.modules)
"""
    run = [sys.executable, "-c", code]
    done = subprocess.run(run, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[3])
    assert done.stdout.split() == ["False", "True", "False"]


def test_errors_say_what_to_do(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such folder; `datagen render"):
        ShardDataset(tmp_path / "nothing")
    with pytest.raises(UsageError, match="found an empty list"):
        ShardDataset([])
    with pytest.raises(InputFileError, match=r"x\.h5: expected a shard, found no such file"):
        ShardDataset([tmp_path / "x.h5"])
    with pytest.raises(UsageError, match=r"expected layers among image,pncc,.* found 'teeth'"):
        ShardDataset(folder, layers=("image", "teeth"))
    with pytest.raises(UsageError, match=r"shard-00000\.h5: expected the layers image,uv, found no uv; render with"):
        ShardDataset(folder, layers=("image", "uv"))
    with pytest.raises(AttributeError, match=r"'pix2face\.shards' has no attribute 'TripletDataset'"):
        _ = pix2face.shards.TripletDataset
    write_shard(folder / "shard-00003.h5", replace(HEADER, model_name="other", model_sha256="f" * 64), [])
    with pytest.raises(ModelMismatchError, match=r"shard-00003\.h5: .* found other \(ffffffffffff\) beside synthetic"):
        ShardDataset(folder)


def test_a_damaged_sample_is_named_when_it_is_read(folder: Path) -> None:
    dataset = ShardDataset(folder)
    path = folder / "shard-00002.h5"
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputFileError, match=r"shard-00002\.h5: sample .* is damaged .*`datagen verify"):
        [dataset[index] for index in (3, 4)]
    assert dataset[0].sample_id == "face/0"
