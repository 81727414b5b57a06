"""Some published models have identities only (01_MorphableModel.mat): everything but expressions works with them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datagen.cli import main
from pix2face.fitting.face_fit import fit_face
from pix2face.fitting.from_landmarks import fit_landmarks
from pix2face.geometry.camera import HeadPose
from pix2face.models.model_file import write_stored_model
from pix2face.models.morphable_model import MorphableModel, load_model
from pix2face.shards.shard_reader import ShardReader, shard_paths
from tests.fits import paper_fit
from tests.model_files import stored_small_head
from tests.pix2face.fitting.rendered_faces import render_known_face


@pytest.fixture
def path(tmp_path: Path) -> Path:
    stored = stored_small_head()
    stored = replace(stored, expression_basis=stored.expression_basis[:0], named_expressions={})
    write_stored_model(stored, tmp_path / "model.h5")
    return tmp_path / "model.h5"


@pytest.fixture
def model(path: Path) -> MorphableModel:
    return load_model(path)


@pytest.mark.gl
def test_faces_are_rendered(tmp_path: Path, path: Path) -> None:
    table, out = tmp_path / "a.h5", tmp_path / "shards"
    assert main(["sample", "--n", "2", "--size", "64", "--model", str(path), "--out", str(table)]) == 0
    arguments = ["--coeffs", str(table), "--model", str(path), "--out", str(out), "--workers", "1"]
    assert main(["render", *arguments]) == 0
    reader = ShardReader(shard_paths(out)[0])
    assert reader.read(1).expression.shape == (0,)
    assert reader.read(1).maps.mask.any()


def test_maps_are_fitted(model: MorphableModel) -> None:
    known = render_known_face(model, HeadPose(5, 20, -3), 1, perspective=False)
    fit = fit_face(known.maps, model, paper_fit(camera="affine", regularisation=1.0))
    assert fit.expression.shape == (0,)
    assert np.linalg.norm(fit.vertices - known.vertices, axis=1)[model.is_face_vertex].mean() < 1


def test_landmarks_are_fitted(model: MorphableModel) -> None:
    known = render_known_face(model, HeadPose(5, 20, -3), 2, perspective=False)
    fit = fit_landmarks(model, known.landmarks2d(model))
    assert fit.expression.shape == (0,)
    assert np.linalg.norm(fit.landmarks2d - known.landmarks2d(model), axis=1).mean() < 2
