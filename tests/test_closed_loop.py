"""From known faces through renderer, shard and reader back to camera and landmarks: the whole geometry at once."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datagen.faces.sources import open_source
from datagen.jobs.render_job import RenderJob, shard_header
from datagen.opengl.gl_context import create_gl_context
from datagen.samples.sample_making import SampleMaker
from datagen.sampling.faces import sample_faces
from pix2face.errors import GLUnavailableError
from pix2face.face_files.coefficients import save_coefficients
from pix2face.fitting.face_fit import fit_face
from pix2face.fitting.fit_options import EXACT_MAPS_REGULARISATION, CameraKind
from pix2face.geometry.camera import linearised
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.morphable_model import builtin_model
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.fits import paper_fit

pytestmark = [pytest.mark.gl, pytest.mark.xdist_group("closed loop")]  # the shards are made once
N_FACES = 6
LIMIT = 0.001  # of the eye distance


@pytest.fixture(scope="module")
def shard_of(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Two shards of the same faces: seen through pinholes, and through the affine cameras that are nearest to them."""
    folder = tmp_path_factory.mktemp("closed_loop")
    model = builtin_model()
    table = sample_faces(model, N_FACES, 0, 256)
    save_coefficients(table, folder / "faces.h5")
    job = RenderJob(folder / "faces.h5", "builtin", seed=0, shard_size=N_FACES)
    source = open_source(job.coefficients, model)
    faces = [source.face(index) for index in range(N_FACES)]
    try:
        gl = create_gl_context()
    except GLUnavailableError as error:
        pytest.skip(str(error))
    paths = {}
    with gl:
        maker = SampleMaker(model, gl, seed=0)
        for kind in ("pinhole", "affine"):
            seen = [face if kind == "pinhole" else replace(face, camera=linearised(face.camera)) for face in faces]
            paths[kind] = folder / kind / "shard-00000.h5"
            write_shard(paths[kind], shard_header(job, source, model, ()), [maker.make(face) for face in seen])
    return paths


@pytest.mark.parametrize("kind", ["pinhole", "affine"])
def test_shards_give_camera_and_landmarks_back(shard_of: dict[str, Path], kind: CameraKind) -> None:
    model = builtin_model()
    reader = ShardReader(shard_of[kind])
    for index in range(len(reader)):
        truth = reader.read(index)
        found = fit_face(truth.maps, model, paper_fit(camera=kind, regularisation=EXACT_MAPS_REGULARISATION))
        corners = truth.landmarks3d[[36, 45]]
        flat = linearised(truth.camera)
        scale = np.sqrt(np.linalg.norm(np.cross(flat.matrix[0, :3], flat.matrix[1, :3])))  # px per mm
        eye_distance = float(np.linalg.norm(corners[0] - corners[1]) * scale)
        face = model.mean[model.is_face_vertex][::50]
        camera_error = np.linalg.norm(found.camera.project(face) - truth.camera.project(face), axis=1)
        landmark_error = np.linalg.norm(found.landmarks2d - truth.landmarks2d, axis=1)
        assert camera_error.max() < LIMIT * eye_distance
        assert landmark_error.mean() < LIMIT * eye_distance
        assert landmark_error[truth.visible].mean() < LIMIT * eye_distance
        np.testing.assert_allclose(
            found.vertices[model.landmarks[IBUG68]][truth.visible], truth.landmarks3d[truth.visible], atol=0.3
        )
