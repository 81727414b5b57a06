"""examples/run_onnx.py: what the pages say of exported networks is enough to run them without pix2face."""

import cv2
import numpy as np
import onnxruntime
import pytest
from skimage import data

from examples.run_onnx import read_face, surest_face
from pix2face.detectors.centre_detector import PACKAGED as DETECTOR
from pix2face.detectors.centre_detector import CentreDetector
from pix2face.inference import PACKAGED
from pix2face.inference.centre_files import export_detector
from pix2face.inference.onnx_files import export_onnx
from pix2face.inference.predictor import Predictor

ASTRONAUT = data.astronaut()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize("image", [ASTRONAUT, ASTRONAUT[:300], cv2.resize(ASTRONAUT, None, fx=4, fy=4)])
def test_the_example_reads_a_face_as_pix2face_does(image: np.ndarray) -> None:
    image = np.ascontiguousarray(image) ^ np.random.default_rng(0).integers(0, 32, image.shape, dtype=np.uint8)  # noise
    score, box = surest_face(onnxruntime.InferenceSession(export_detector(DETECTOR)), image)
    found = CentreDetector.load(DETECTOR).candidates(image)[0]
    assert score == pytest.approx(found.score, rel=0.05)  # the picture is scaled in another way
    assert box == pytest.approx(found.box.sides, abs=0.05 * found.box.longer_side)  # one cell instead of nine

    face = read_face(onnxruntime.InferenceSession(export_onnx(PACKAGED)[1]), image, np.array(found.box.sides))
    predictor = Predictor.load(PACKAGED, "cpu")
    maps = predictor.predict(image, found.box).maps
    ((crop, landmarks),) = predictor.predict_landmarks([(image, found.box)])
    assert (face["mask"] != maps.mask).mean() < 1e-3
    both = face["mask"] & maps.mask
    assert face["pncc_mm"][both] == pytest.approx(maps.pncc[both], abs=0.5)
    assert face["offset_mm"][both] == pytest.approx(maps.offset[both], abs=0.5)
    assert face["landmarks_px"] == pytest.approx(crop.to_image(landmarks.points2d), abs=0.002 * found.box.longer_side)
