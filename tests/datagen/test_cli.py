"""``datagen`` from its arguments to files and exit status; the job itself is tested in test_pipeline."""

import shutil
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from datagen.cli import main
from datagen.inspection.preview import HEADING_PX
from pix2face.face_files.coefficients import load_coefficients
from pix2face.files.images import encode_image
from pix2face.models.morphable_model import builtin_model
from pix2face.shards.shard_reader import ShardHeader, ShardReader, shard_paths
from pix2face.shards.shard_writing import write_shard
from tests.model_files import write_small_head
from tests.pix2face.benchmark_files import write_heldout
from tests.synthetic_models import small_head_model


def call(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def assert_one_line(capsys: pytest.CaptureFixture[str], message: str) -> None:
    error = capsys.readouterr().err
    assert error.startswith("datagen: error: ")
    assert message in error
    assert error.count("\n") == 1


@pytest.fixture
def model_path(tmp_path: Path) -> Path:
    return write_small_head(tmp_path / "model.h5")


@pytest.fixture
def shards(tmp_path: Path) -> Path:
    """Three samples in two shards."""
    write_heldout(tmp_path / "shards", small_head_model(), n=2)
    reader = ShardReader(tmp_path / "shards" / "shard-00000.h5")
    header, triplet = reader.header, reader.read(1)
    write_shard(tmp_path / "shards" / "shard-00001.h5", header, [replace(triplet, sample_id="third")])
    return tmp_path / "shards"


def test_sampling_writes_a_table_of_the_model(
    tmp_path: Path, model_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new folder" / "faces.h5"
    assert call("sample", "--n", 3, "--seed", 7, "--size", 80, "--model", model_path, "--out", out) == 0
    table = load_coefficients(out)
    assert table.sample_ids == ("seed7/0000000", "seed7/0000001", "seed7/0000002")
    assert (table.sizes_px == 80).all()
    assert table.model_name == small_head_model().name
    assert f"datagen render --coeffs {out}" in capsys.readouterr().err


def test_sampling_takes_the_builtin_model_unless_told_otherwise(tmp_path: Path) -> None:
    assert call("sample", "--n", 1, "--out", tmp_path / "faces.h5") == 0
    assert load_coefficients(tmp_path / "faces.h5").model_sha256 == builtin_model().sha256


@pytest.mark.parametrize(
    "arguments", [("--n", 0), ("--n", 10_000_001), ("--size", 15), ("--size", 16385), ("--seed", -1)]
)
def test_a_draw_that_makes_no_sense_is_one_line(
    arguments: tuple[object, ...], tmp_path: Path, model_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("sample", *arguments, "--model", model_path, "--out", tmp_path / "faces.h5") == 2
    option, found = arguments
    error = capsys.readouterr().err
    assert error.startswith(f"datagen: error: {option}: expected ")
    assert error.endswith(f"found {found}\n")
    assert error.count("\n") == 1
    assert not (tmp_path / "faces.h5").exists()


FILES = [
    ("sample", "--n", 10**7),
    ("preview", "{t}/shards"),
    ("stats", "{t}/shards"),
    ("coeffs", "convert", "--from", "{t}"),
    ("coeffs", "retarget", "--from", "{t}/absent.h5", "--to", "builtin"),
    ("fit", "--landmarks", "{t}"),
    ("model", "import", "{t}/absent"),
    ("model", "view", "{t}/absent.h5"),
]


@pytest.mark.parametrize("arguments", FILES)
def test_a_file_that_cannot_be_written_is_one_line_before_any_work(
    arguments: tuple[object, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    suffix = ".png" if {"preview", "stats", "view"} & {*arguments} else ".h5"
    call_to = [str(argument).format(t=tmp_path) for argument in arguments]
    (tmp_path / f"folder{suffix}").mkdir()
    (tmp_path / "file").write_bytes(b"kept")
    for name, message in (
        ("faces.xyz", "expected a file ending in "),
        ("faces", "as --out, found no ending"),
        (f"folder{suffix}", "expected a file to write, found a folder; choose another --out"),
        (f"file/deep/faces{suffix}", f"found that {tmp_path / 'file'} is a file; choose another --out"),
    ):
        assert call(*call_to, "--out", tmp_path / name) == 2
        assert_one_line(capsys, message)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", f"folder{suffix}"]
    assert (tmp_path / "file").read_bytes() == b"kept"


def test_shards_cannot_go_where_a_file_is(tmp_path: Path, model_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "faces.h5"
    assert call("sample", "--n", 1, "--model", model_path, "--out", table) == 0
    for out in (table, table / "shards"):
        capsys.readouterr()
        assert call("render", "--coeffs", table, "--model", model_path, "--out", out) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert error.startswith(f"datagen: error: {out}: expected a folder that can be written to, found that {table}")
    assert len(load_coefficients(table)) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("render", "--coeffs", "{t}", "--out", "{t}/out"),
        ("coeffs", "convert", "--from", "{t}", "--out", "{t}/out.h5"),
        ("fit", "--landmarks", "{t}", "--out", "{t}/out.h5"),
    ],
)
def test_fewer_than_no_rejected_samples_are_one_line(
    arguments: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(*(argument.format(t=tmp_path) for argument in arguments), "--max-rejected", -1) == 2
    assert_one_line(capsys, "--max-rejected: expected 0 or more, found -1")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("n", "rows"), [(1, 1), (2, 1), (3, 2), (99, 2)])
def test_a_contact_sheet_has_two_columns_of_samples(shards: Path, n: int, rows: int) -> None:
    assert call("preview", shards, "--n", n, "--out", shards / "deep" / "sheet.png") == 0
    sheet = cv2.imread(str(shards / "deep" / "sheet.png"))
    assert sheet.shape == (HEADING_PX + 180 * rows, 2 * 5 * 180, 3)
    last = sheet[-180:, 900:]
    assert (last == 255).all() == (n in (1, 3, 99))  # nothing beside an odd sample


def test_a_contact_sheet_survives_pictures_of_other_shapes_and_far_landmarks(tmp_path: Path) -> None:
    write_heldout(tmp_path, small_head_model(), n=1)
    reader = ShardReader(tmp_path / "shard-00000.h5")
    header, triplet = reader.header, reader.read(0)
    layers = {name: value[:, :150] for name, value in triplet.layers.items()}
    landmarks2d = triplet.landmarks2d.copy()
    landmarks2d[:2] = [[1e30, 0], [-1e5, 20]]
    image = encode_image(np.zeros((200, 150, 3), np.uint8))
    narrow = replace(triplet, layers=layers, image_bytes=image, landmarks2d=landmarks2d)
    write_shard(tmp_path / "shard-00001.h5", header, [replace(narrow, sample_id="narrow")])
    assert call("preview", tmp_path) == 0
    assert cv2.imread(str(tmp_path / "preview.jpg")).shape == (HEADING_PX + 180, 1800, 3)


def test_previews_that_cannot_be_made_are_one_line(
    shards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("preview", shards, "--n", 0) == 2
    assert_one_line(capsys, "at least one sample to show (--n), found 0")
    assert call("preview", shards, "--out", tmp_path / "sheet.gif") == 2
    assert_one_line(capsys, "sheet.gif: expected a file ending in .jpg, .jpeg, .png or .html as --out, found '.gif'")
    reader = ShardReader(shard_paths(shards)[0])
    header = ShardHeader(**asdict(reader.header))
    write_shard(tmp_path / "empty" / "shard-00000.h5", header, [])
    assert call("preview", tmp_path / "empty") == 2
    assert_one_line(capsys, "found empty shards; see rejected.jsonl")


@pytest.mark.gl
def test_a_folder_is_not_completed_from_another_table_of_the_same_name(
    tmp_path: Path, model_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, out = tmp_path / "faces.h5", tmp_path / "out"
    sample = ("sample", "--n", 4, "--size", 32, "--model", model_path, "--out", table)
    render = ("render", "--coeffs", table, "--out", out, "--model", model_path, "--workers", 1, "--shard-size", 2)
    assert call(*sample) == 0
    assert call(*render) == 0
    (out / "shard-00001.h5").unlink()
    assert call(*sample, "--seed", 1) == 0
    capsys.readouterr()
    assert call(*render) == 2
    error = capsys.readouterr().err
    assert "shard-00000.h5 was made by another configuration (coefficients_sha256 " in error
    assert "; delete it or choose another --out" in error
    assert call(*render, "--seed", 3) == 2
    error = capsys.readouterr().err
    assert "; seed 0 -> 3); delete it" in error
    assert "{" not in error
    assert call(*sample, "--seed", 0) == 0
    assert call(*render) == 0
    assert "4 triplets in 2 shards (1 there already)" in capsys.readouterr().err


@pytest.mark.gl
def test_shards_of_a_larger_job_are_refused(
    tmp_path: Path, model_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, out = tmp_path / "faces.h5", tmp_path / "out"
    assert call("sample", "--n", 2, "--size", 32, "--model", model_path, "--out", table) == 0
    render = ("render", "--coeffs", table, "--out", out, "--model", model_path, "--workers", 1)
    assert call(*render) == 0
    shutil.copy(out / "shard-00000.h5", out / "shard-00007.h5")
    capsys.readouterr()
    assert call(*render) == 2
    assert "shard-00007.h5 does not belong to this job, whose last shard is shard-00000.h5" in capsys.readouterr().err


@pytest.mark.gl
def test_the_builtin_model_is_said_to_be_fitted_to_landmarks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mats").mkdir()
    (tmp_path / "mats" / "broken.mat").write_bytes(b"no MAT file")
    arguments = ("--coeffs", tmp_path / "mats", "--out", tmp_path / "out", "--workers", 1)
    assert call("render", *arguments, "--max-rejected", 1) == 0
    error = capsys.readouterr().err
    assert "the built-in model is fitted to the landmarks of the files instead" in error
    assert "0 triplets in 1 shard " in error
