"""The job from coefficients to shards: complete, resumable, the same for any number of workers, hard to break."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io

from datagen.cli import main
from datagen.jobs.executors import ProcessPool
from datagen.jobs.pipeline import JobSummary, Listener, open_job, run_job
from datagen.jobs.render_job import RenderJob
from datagen.sampling.faces import sample_faces
from pix2face.errors import UsageError
from pix2face.face_files.coefficients import load_coefficients, save_coefficients
from pix2face.models.morphable_model import load_model
from pix2face.models.rasterise import render_maps
from pix2face.shards.layers import DEFAULT_LAYERS
from pix2face.shards.shard_checks import verify_shard
from pix2face.shards.shard_reader import ShardReader, shard_paths
from tests.model_files import write_small_head
from tests.synthetic_models import small_head_model

pytestmark = [pytest.mark.gl, pytest.mark.xdist_group("pipeline")]  # the shards are rendered once


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model and a table of 11 faces."""
    folder = tmp_path_factory.mktemp("inputs")
    model = load_model(write_small_head(folder / "model.h5"))
    save_coefficients(sample_faces(model, 11, 0, 64), folder / "faces.h5")
    return folder


def run(inputs: Path, out: Path, workers: int = 1) -> JobSummary:
    job = RenderJob(
        inputs / "faces.h5", str(inputs / "model.h5"), seed=0, shard_size=4, layers=(*DEFAULT_LAYERS, "depth")
    )
    return run_job(open_job(job), out, ProcessPool(workers))


@pytest.fixture(scope="module")
def rendered(inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("rendered")
    summary = run(inputs, out)
    assert (summary.n_triplets, summary.n_shards, summary.n_shards_kept) == (11, 3, 0)
    assert summary.rejected == ()
    return out


def test_shards_hold_every_face_and_verify(rendered: Path, inputs: Path) -> None:
    ids = []
    for path in shard_paths(rendered):
        assert verify_shard(path) == []
        reader = ShardReader(path)
        ids += reader.sample_ids
    assert tuple(ids) == load_coefficients(inputs / "faces.h5").sample_ids
    assert (rendered / "rejected.jsonl").read_text() == ""


def test_shards_hold_what_the_oracle_renders(rendered: Path, inputs: Path) -> None:
    model = load_model(inputs / "model.h5")
    reader = ShardReader(shard_paths(rendered)[1])
    triplet = reader.read(0)
    vertices = model.vertices(triplet.identity[None], triplet.expression[None])[0]
    expected = render_maps(model, vertices, triplet.camera, 64, 64)
    both = triplet.maps.mask & expected["mask"]
    assert (triplet.maps.mask != expected["mask"]).mean() < 1e-3
    assert both.sum() > 300
    assert np.abs(triplet.maps.pncc - expected["pncc"])[both].max() < 0.03
    assert np.abs(triplet.maps.offset - expected["offset"])[both].max() < 0.03
    np.testing.assert_allclose(
        triplet.landmarks2d, triplet.camera.project(vertices[model.landmarks["ibug68"]]), atol=1e-3
    )


def test_a_second_run_does_what_is_missing(rendered: Path, inputs: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(rendered, out)
    (out / "shard-00001.h5").unlink()
    untouched = (out / "shard-00000.h5").stat().st_mtime_ns
    summary = run(inputs, out)
    assert summary.n_shards_kept == 2
    assert summary.n_triplets == 11
    assert (out / "shard-00000.h5").stat().st_mtime_ns == untouched
    assert (out / "shard-00001.h5").read_bytes() == (rendered / "shard-00001.h5").read_bytes()


def test_shards_have_the_layers_that_were_asked_for(inputs: Path, rendered: Path, tmp_path: Path) -> None:
    layers = ("offset", "mask", "normals", "regions")
    job = RenderJob(inputs / "faces.h5", str(inputs / "model.h5"), 0, 6, layers)
    progress: list[int] = []
    run_job(open_job(job), tmp_path, ProcessPool(1), listener=Listener(on_progress=progress.append))
    assert sum(progress) == 11
    assert max(progress) < 6  # samples are counted, not shards
    found, expected = ShardReader(shard_paths(tmp_path)[0]), ShardReader(shard_paths(rendered)[0])
    assert found.header.layers == layers
    sample = found.read(1)
    assert sample.image_bytes is None
    assert set(sample.layers) == set(layers)
    assert len(sample.landmarks2d) == 0
    np.testing.assert_array_equal(sample.layers["offset"], expected.read(1).layers["offset"])
    lengths = np.linalg.norm(sample.layers["normals"][sample.layers["mask"]], axis=1)
    np.testing.assert_allclose(lengths, 1, atol=1e-3)
    assert verify_shard(shard_paths(tmp_path)[1]) == []
    other = replace(job, layers=("offset", "mask"))
    with pytest.raises(UsageError, match=r"\(layers offset,mask,normals,regions -> offset,mask\)"):
        run_job(open_job(other), tmp_path, ProcessPool(1))


def test_a_summary_says_where_the_time_went(inputs: Path, tmp_path: Path) -> None:
    summary = run(inputs, tmp_path)
    stages = {"read coefficients", "geometry", "rasterise, read back", "draw picture", "encode", "write, check"}
    assert stages <= set(summary.times.cpu_seconds)
    assert all(value >= 0 for value in summary.times.cpu_seconds.values())
    assert len(summary.peaks_bytes) == 3
    assert all(10e6 < peak < 4e9 for peak in summary.peaks_bytes)
    again = run(inputs, tmp_path)
    assert (again.times.cpu_seconds, again.peaks_bytes) == ({}, ())


def mat_fields(**changes: object) -> dict[str, object]:
    """A face of the small head seen from the front at 2 px per mm, as AFLW2000-3D would describe it."""
    model = small_head_model()
    points = model.mean[model.landmarks["ibug68"]].astype(np.float64)
    pixels = np.stack([points[:, 0] * 0.5 + 60.5, 60.5 - points[:, 1] * 0.5, points[:, 2] * 0.5])
    fields: dict[str, object] = {
        "Shape_Para": np.zeros((199, 1)),
        "Exp_Para": np.zeros((29, 1)),
        "Pose_Para": np.array([[0, 0, 0, 60, 60, 0, 0.0005]]),
        "pt3d_68": pixels.astype(np.float32),
    }
    fields.update(changes)
    return fields


def test_bad_samples_are_listed_and_nothing_else_is_lost(inputs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "mats"
    (folder / "deep").mkdir(parents=True)
    image = np.random.default_rng(0).integers(0, 256, (120, 120, 3), dtype=np.uint8)
    jpeg = cv2.imencode(".jpg", image)[1].tobytes()
    for name in ("good", "deep/good", "nan", "truncated", "foreign", "broken_picture"):
        (folder / f"{name}.jpg").write_bytes(jpeg)
        scipy.io.savemat(folder / f"{name}.mat", mat_fields())
    scipy.io.savemat(folder / "no_picture.mat", mat_fields())
    scipy.io.savemat(folder / "nan.mat", mat_fields(Exp_Para=np.full((29, 1), np.nan)))
    scipy.io.savemat(folder / "foreign.mat", {"pts": np.zeros((68, 2))})
    (folder / "truncated.mat").write_bytes((folder / "good.mat").read_bytes()[:900])
    (folder / "broken_picture.jpg").write_bytes(jpeg[:100])
    (folder / "loop").symlink_to(folder)
    out = tmp_path / "out"
    arguments = ["render", "--coeffs", str(folder), "--out", str(out), "--model", str(inputs / "model.h5")]
    assert main([*arguments, "--workers", "1"]) == 3
    rejected = [json.loads(line) for line in (out / "rejected.jsonl").read_text().splitlines()]
    assert {entry["sample_id"] for entry in rejected} == {"nan", "truncated", "foreign", "broken_picture", "no_picture"}
    reasons = {entry["sample_id"]: entry["reason"] for entry in rejected}
    assert "NaN" in reasons["nan"]
    assert "cannot be read" in reasons["truncated"]
    assert "missing are Shape_Para" in reasons["foreign"]
    assert "expected its picture no_picture.jpg" in reasons["no_picture"]
    reader = ShardReader(shard_paths(out)[0])
    assert reader.sample_ids == ["deep/good", "good"]
    assert reader.read(0).image_bytes == jpeg  # the photograph's own bytes
    np.testing.assert_allclose(
        reader.read(0, ()).landmarks2d, np.asarray(mat_fields()["pt3d_68"])[:2].T - 0.5, atol=0.2
    )
    assert main([*arguments, "--workers", "1", "--max-rejected", "5"]) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["render", "--coeffs", "{tmp}/nothing", "--out", "{tmp}/o"], "found nothing there"),
        (["render", "--coeffs", "{tmp}", "--out", "{tmp}/o"], "expected .mat files"),
        (["render", "--coeffs", "{faces}", "--out", "{tmp}/o"], "give the former with --model"),
        (["render", "--coeffs", "{faces}", "--out", "{tmp}/o", "--model", "{tmp}/x.h5"], "no such model file"),
        (["render", "--coeffs", "{faces}", "--out", "{tmp}/o", "--workers", "0"], "--workers"),
        (["render", "--coeffs", "{faces}", "--out", "{tmp}/o", "--layers", "image,pnc"], "found 'pnc'"),
        (["render", "--coeffs", "{faces}", "--out", "{tmp}/o", "--layers", ""], "expected layers among image,pncc"),
        (["render", "--coeffs", "{faces}", "--out", "{tmp}/o", "--gl", "osmesa", "--device", "0"], "no device"),
        (
            ["render", "--coeffs", "{faces}", "--out", "{tmp}/o", "--model", "{model}", "--layers", "uv"],
            "expected a model with texture coordinates",
        ),
        (["verify", "{tmp}"], "no shard-"),
        (["preview", "{tmp}"], "no shard-"),
    ],
)
def test_wrong_calls_are_one_clear_line(
    arguments: list[str], message: str, inputs: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    values = {"tmp": str(tmp_path), "faces": str(inputs / "faces.h5"), "model": str(inputs / "model.h5")}
    assert main([argument.format(**values) for argument in arguments]) == 2
    error = capfd.readouterr().err.splitlines()[-1]
    assert error.startswith("datagen: error: ")
    assert message in error
