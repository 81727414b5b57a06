"""Shards in other people's programs: the examples run on what datagen renders, and the data set returns just that."""

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from datagen.cli import main
from datagen.faces.sources import open_source
from datagen.opengl.gl_context import GLContext
from datagen.samples.sample_making import SampleMaker
from pix2face.models.morphable_model import builtin_model
from pix2face.shards import Sample, ShardDataset
from pix2face.shards.layers import LAYERS

pytestmark = pytest.mark.xdist_group("own trainers")  # the shards are rendered once

ROOT = Path(__file__).parents[2]
N_FACES, SIZE = 6, 48


@pytest.fixture(scope="module")
def rendered(gl_session: GLContext, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Sample]]:
    """A folder of two shards as the commands make it, and the samples that went into it."""
    folder = tmp_path_factory.mktemp("own_trainers")
    table, shards = folder / "faces.h5", folder / "shards"
    assert main(["sample", "--n", str(N_FACES), "--seed", "5", "--size", str(SIZE), "--out", str(table)]) == 0
    options = ["--appearance", "plain", "--shard-size", "4", "--workers", "1"]
    assert main(["render", "--coeffs", str(table), "--out", str(shards), *options]) == 0
    maker = SampleMaker(builtin_model(), gl_session, seed=0)
    faces = open_source(table, builtin_model())
    return shards, [maker.make(faces.face(index)) for index in range(N_FACES)]


def test_plain_maps_are_the_coded_ones(rendered: tuple[Path, list[Sample]]) -> None:
    shards, _ = rendered
    plain = shards.parent / "plain"
    options = ["--appearance", "plain", "--shard-size", "6", "--workers", "1", "--plain"]
    assert main(["render", "--coeffs", str(shards.parent / "faces.h5"), "--out", str(plain), *options]) == 0
    coded = ShardDataset(shards)
    with h5py.File(plain / "shard-00000.h5") as file:
        for index, sample in enumerate(coded):
            np.testing.assert_array_equal(file["pncc"][index], sample.layers["pncc"])
            np.testing.assert_array_equal(file["offset"][index], sample.layers["offset"])
    assert ShardDataset(plain).header.configuration != coded.header.configuration  # a folder holds either


def test_a_data_set_returns_what_was_rendered(rendered: tuple[Path, list[Sample]]) -> None:
    shards, made = rendered
    dataset = ShardDataset(shards)
    assert len(dataset) == len(made) == N_FACES
    for found, expected in zip(dataset, made, strict=True):
        assert found.sample_id == expected.sample_id
        assert found.image_bytes == expected.image_bytes
        np.testing.assert_array_equal(found.image, expected.image)
        assert (found.image.dtype, found.image.shape) == (np.uint8, (SIZE, SIZE, 3))
        for name in ("pncc", "offset", "mask"):
            assert found.layers[name].dtype == LAYERS[name].dtype
            error = np.abs(found.layers[name].astype(np.float32) - expected.layers[name])
            assert error.max() <= 0.5 / 128 + 1e-5
        np.testing.assert_array_equal(found.camera.matrix, expected.camera.matrix)
        for name in ("identity", "expression", "landmarks2d", "landmarks3d", "visible"):
            np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-6, atol=1e-4)
        assert found.attributes == pytest.approx(expected.attributes)


def run_example(name: str, *arguments: object) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", ROOT / "examples" / name, *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin", "OMP_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_network_of_ones_own_learns_in_thirty_lines(rendered: tuple[Path, list[Sample]]) -> None:
    errors = [float(line.split()[2]) for line in run_example("train_own_network.py", rendered[0]).splitlines()]
    assert len(errors) == 10
    assert errors[-1] < errors[0]
    assert len((ROOT / "examples" / "train_own_network.py").read_text().splitlines()) <= 30


@pytest.mark.parametrize("index", [0, 3])
def test_h5py_alone_reads_the_same(rendered: tuple[Path, list[Sample]], index: int) -> None:
    shards, made = rendered
    path = shards / "shard-00000.h5"
    first, second, third = run_example("read_with_h5py.py", path, index).splitlines()
    maps = made[index].maps
    assert first == f"{made[index].sample_id} plain"
    assert second == f"{SIZE} x {SIZE} px, a picture of {len(made[index].image_bytes or b'')} bytes, a face of " + (
        f"{maps.mask.sum()} pixels"
    )
    found = np.array(third.split("[")[1].rstrip("]").split(","), dtype=float)
    np.testing.assert_allclose(found, maps.pncc[maps.mask].mean(axis=0), atol=0.005)
    with h5py.File(path) as file:
        assert len(file["sample_id"]) == 4
