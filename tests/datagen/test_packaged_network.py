"""The network that the package brings along, on renders that it has not seen."""

from pathlib import Path

import numpy as np
import pytest

from datagen.appearance.appearance_config import DEFAULT, PRESETS
from datagen.opengl.gl_context import GLContext
from datagen.samples.sample_making import SampleMaker
from datagen.sampling.faces import sample_faces
from pix2face.files.images import decode_image
from pix2face.geometry.camera import head_pose
from pix2face.geometry.crops import FaceBox
from pix2face.inference import PACKAGED
from pix2face.inference.predictor import Predictor
from pix2face.models.morphable_model import builtin_model
from pix2face.shards.layers import DEFAULT_LAYERS, SCENE_LAYERS

pytestmark = pytest.mark.gl

SEED, N, SIZE = 77, 80, 128


def test_profiles_to_either_side_have_the_same_mask(gl_session: GLContext, tmp_path: Path) -> None:
    """Networks have failed on profiles to one side while all means looked well."""
    predictor = Predictor.load(PACKAGED, "cpu")
    table = sample_faces(builtin_model(), N, SEED, SIZE, PRESETS[DEFAULT].geometry)
    maker = SampleMaker(builtin_model(), gl_session, SEED, (*DEFAULT_LAYERS, *SCENE_LAYERS), PRESETS[DEFAULT])
    ratios = {}
    for index in range(N):
        face = table.face(index, tmp_path)
        if abs(head_pose(face.camera).yaw_deg) < 65:
            continue
        sample = maker.make(face)
        image, box = decode_image(sample.image_bytes, sample.sample_id), FaceBox.around(sample.landmarks2d)
        mirrored = FaceBox(image.shape[1] - box.right, box.top, image.shape[1] - box.left, box.bottom)
        one, other = predictor.predict_batch([(image, box), (np.ascontiguousarray(image[:, ::-1]), mirrored)])
        ratios[sample.sample_id] = one.maps.mask.sum() / other.maps.mask.sum()
    assert len(ratios) >= 10
    assert all(0.75 < ratio < 1.33 for ratio in ratios.values()), ratios
