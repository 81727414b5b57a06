"""Folders become tables: complete, the same for any number of workers, hard to break."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io

from datagen.cli import main
from datagen.faces.sources import TableSource, W300LPFolder
from datagen.inspection.coefficient_summary import group_reasons
from datagen.jobs.conversion import FACES_PER_TASK, ConversionJob, ConversionSummary, convert
from datagen.process_pool import process_pool
from pix2face.errors import UsageError
from pix2face.face_files.coefficients import load_coefficients
from pix2face.models.morphable_model import MorphableModel, load_model
from tests.model_files import write_small_head

pytestmark = pytest.mark.xdist_group("conversion")  # the folder is converted once

SIZE_PX = 60


@pytest.fixture(scope="module")
def model_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small_head(tmp_path_factory.mktemp("model") / "model.h5")


def write_face(path: Path, model: MorphableModel, seed: int, **changes: object) -> None:
    """A file of AFLW2000-3D with its picture: the small head, a little out of shape."""
    rng = np.random.default_rng(seed)
    points = model.mean[model.landmarks["ibug68"]].astype(np.float64) + rng.normal(0, 1, (68, 3))
    pixels = np.stack([points[:, 0] * 0.2 + 30.5, 30.5 - points[:, 1] * 0.2, points[:, 2] * 0.2])
    fields: dict[str, object] = {
        "Shape_Para": rng.normal(size=(199, 1)),
        "Exp_Para": rng.normal(size=(29, 1)),
        "Pose_Para": np.array([[0, 0, 0, 30, 30, 0, 0.0002]]),
        "Illum_Para": rng.normal(size=(1, 10)),
        "pt3d_68": pixels.astype(np.float32),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    scipy.io.savemat(path, {**fields, **changes})
    cv2.imwrite(str(path.with_suffix(".jpg")), np.full((SIZE_PX, SIZE_PX, 3), 99, np.uint8))


def spoil(folder: Path, model: MorphableModel) -> None:
    """Adds two files that cannot be converted."""
    (folder / "broken.mat").write_bytes(b"noise")
    write_face(folder / "alone.mat", model, 0)
    (folder / "alone.jpg").unlink()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, model_path: Path) -> Path:
    """More faces than fit into two tasks, some bad, in nested folders with a landmark folder beside them."""
    root, model = tmp_path_factory.mktemp("data"), load_model(model_path)
    for index in range(2 * FACES_PER_TASK + 5):
        write_face(root / ("AFW" if index % 2 else "AFW_Flip") / f"face_{index:04}.mat", model, index)
    spoil(root / "AFW", model)
    (root / "landmarks" / "AFW").mkdir(parents=True)
    scipy.io.savemat(root / "landmarks" / "AFW" / "face_0000_pts.mat", {"pts_3d": np.zeros((68, 2))})
    return root


@pytest.fixture(scope="module")
def converted(
    folder: Path, model_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, ConversionSummary]:
    out = tmp_path_factory.mktemp("out") / "faces.h5"
    done: list[int] = []
    summary = convert(ConversionJob(folder, "300wlp", str(model_path)), out, None, done.append)
    assert sum(done) == 2 * FACES_PER_TASK + 7
    return out, summary


def test_the_table_holds_what_the_folder_gives(
    converted: tuple[Path, ConversionSummary], folder: Path, model_path: Path
) -> None:
    out, summary = converted
    model = load_model(model_path)
    source, table = W300LPFolder(folder, model), TableSource(out, model)
    bad = {"AFW/alone", "AFW/broken"}
    assert table.sample_ids == tuple(name for name in source.sample_ids if name not in bad)
    assert summary.n_faces == len(table.sample_ids) == 2 * FACES_PER_TASK + 5
    assert "research use only" in table.licence
    for index in (0, 70, 132):
        found, expected = table.face(index), source.face(source.sample_ids.index(table.sample_ids[index]))
        np.testing.assert_array_equal(found.identity, expected.identity)
        np.testing.assert_array_equal(found.expression, expected.expression)
        np.testing.assert_array_equal(found.camera.matrix, expected.camera.matrix)
        np.testing.assert_allclose(found.lighting, expected.lighting, rtol=1e-6)
        assert found.image_path is not None
        assert expected.image_path is not None
        assert found.image_path.samefile(expected.image_path)
        assert found.attributes == expected.attributes == {"geometry": "fitted to pt3d_68"}


def test_bad_files_are_listed_beside_the_table_and_in_it(converted: tuple[Path, ConversionSummary]) -> None:
    out, summary = converted
    lines = [json.loads(line) for line in (out.parent / "faces.rejected.jsonl").read_text().splitlines()]
    assert [line["sample_id"] for line in lines] == ["AFW/alone", "AFW/broken"]
    assert "expected its picture alone.jpg" in lines[0]["reason"]
    assert "expected a MAT 5 file" in lines[1]["reason"]
    expected = tuple((line["sample_id"], line["reason"]) for line in lines)
    assert load_coefficients(out).rejected == summary.rejected == expected


def test_two_tables_in_one_folder_keep_their_lists(folder: Path, model_path: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "AFW_Flip", tmp_path / "photographs")
    for path in sorted((tmp_path / "photographs").glob("*.mat"))[2:]:
        path.unlink()
    job = ConversionJob(tmp_path / "photographs", "300wlp", str(model_path))
    for name, bad in (("a", "first"), ("b", "second")):
        (job.folder / f"{bad}.mat").write_bytes(b"noise")
        convert(job, tmp_path / f"{name}.h5", None, lambda n: None)
        (job.folder / f"{bad}.mat").unlink()
    for name, bad in (("a", "first"), ("b", "second")):
        (line,) = (tmp_path / f"{name}.rejected.jsonl").read_text().splitlines()
        assert json.loads(line)["sample_id"] == bad
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {
        *("a.h5", "a.rejected.jsonl", "b.h5", "b.rejected.jsonl"),
    }


def test_more_workers_give_the_same_bytes(
    converted: tuple[Path, ConversionSummary], folder: Path, model_path: Path, tmp_path: Path
) -> None:
    # As deep as the other table, so that pictures have the same relative paths.
    out = converted[0].parent.with_name("workers") / "faces.h5"
    with process_pool(2) as executor:
        convert(ConversionJob(folder, "300wlp", str(model_path)), out, executor, lambda n: None)
    assert out.read_bytes() == converted[0].read_bytes()


def test_the_command_says_what_it_did(model_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, model = tmp_path / "photographs", load_model(model_path)
    for index in range(5):
        write_face(folder / "AFW" / f"face_{index}.mat", model, index)
    spoil(folder / "AFW", model)
    out = tmp_path / "faces.h5"
    arguments = ["coeffs", "convert", "--from", str(folder), "--model", str(model_path), "--out", str(out)]
    arguments += ["--workers", "1"]
    assert main(arguments) == 3
    said = capsys.readouterr().err
    assert "5 faces ->" in said
    assert f"2 rejected, listed in {tmp_path}/faces.rejected.jsonl:" in said
    assert "1 x ... expected its picture alone.jpg beside it, found none" in said
    assert f"datagen render --coeffs {out} --model {model_path}" in said
    assert main([*arguments, "--max-rejected", "2"]) == 0
    capsys.readouterr()
    assert main(["coeffs", "info", str(out)]) == 0
    shown = capsys.readouterr().out
    for expected in ("5 (5 with a photograph)", "small synthetic head", "beyond 3 sd", "60 x 60", "10 numbers a face"):
        assert expected in shown
    assert main(["coeffs", "info", str(folder)]) == 0
    shown = capsys.readouterr().out
    for expected in ("5 with a picture, 2 that", "pt3d_68 in 5", "1 x ... expected its picture", "0 to 15 °"):
        assert expected in shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["coeffs", "convert", "--from", "nothing", "--out", "a.h5"], "expected a folder of 300W-LP"),
        (["coeffs", "convert", "--from", ".", "--out", "a.h5"], "expected .mat files"),
        (["coeffs", "convert", "--from", ".", "--out", "a.csv"], "ending in .h5"),
        (["coeffs", "convert", "--from", ".", "--out", "a.h5", "--workers", "0"], "at least one worker"),
        (["coeffs", "info", "nothing"], "found nothing there"),
        (["coeffs", "info", "."], "found none"),
        (["fit", "--landmarks", "nothing", "--out", "a.h5"], "expected a folder of annotated photographs"),
        (["fit", "--landmarks", ".", "--out", "a.h5"], "68 points each"),
    ],
)
def test_wrong_calls_are_one_line(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_bad_files_alone_is_an_error_and_leaves_no_table(tmp_path: Path, model_path: Path) -> None:
    (tmp_path / "face.mat").write_bytes(b"noise")
    out = tmp_path / "out" / "faces.h5"
    with pytest.raises(UsageError, match=r"expected at least one face that can be used.*MAT 5"):
        convert(ConversionJob(tmp_path, "300wlp", str(model_path)), out, None, lambda n: None)
    assert not out.exists()


def test_reasons_are_grouped_whatever_file_they_name() -> None:
    rejected = [(f"a/b_{i}", f"/data/a/b_{i}.mat: expected numbers") for i in range(3)] + [("c", "no picture of c")]
    assert group_reasons(rejected) == (("... expected numbers", 3), ("no picture of ...", 1))
