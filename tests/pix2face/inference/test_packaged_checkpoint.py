"""The checkpoint that the package brings along: whole, small, and good on photographs."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from jaxtyping import Float64
from numpy import ndarray
from safetensors import safe_open
from skimage.data import astronaut

from pix2face import Pix2Face
from pix2face.face_files.annotations import find_annotations
from pix2face.files.images import read_photograph
from pix2face.fitting.fit_options import FitOptions, LandmarkType
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.landmark_metrics import landmark_errors
from pix2face.geometry.landmarks import IBUG68, IBUG68_2D, INNER51, MIRRORS
from pix2face.inference import PACKAGED

LARGEST_BYTES = 20_000_000
# Marked by hand: outer and inner corners of the eyes, tip of the nose, corners of the mouth, chin.
ASTRONAUT = {
    36: (194.0, 100.5),
    39: (212.0, 103.0),
    42: (236.0, 104.0),
    45: (259.0, 102.0),
    30: (224.0, 126.0),
    48: (203.0, 140.0),
    54: (245.0, 140.0),
    8: (223.0, 178.0),
}


@pytest.fixture(scope="module")
def faces() -> Pix2Face:
    return Pix2Face.load(device="cpu")


def nme(found: Float64[ndarray, "n 2"], true: Float64[ndarray, "n 2"]) -> float:
    width, height = np.ptp(true, axis=0)
    return float(np.linalg.norm(found - true, axis=1).mean() / np.sqrt(width * height))


def test_it_is_half_precision_and_small() -> None:
    assert PACKAGED.stat().st_size <= LARGEST_BYTES
    with safe_open(PACKAGED, framework="pt") as file:
        weights = [file.get_tensor(name) for name in file.keys() if name.endswith("weight")]  # noqa: SIM118
    assert {str(own.dtype) for own in weights if own.ndim > 1} == {"torch.float16"}


def test_every_number_in_it_is_finite() -> None:
    with safe_open(PACKAGED, framework="pt") as file:
        for name in file.keys():  # noqa: SIM118
            assert bool(file.get_tensor(name).isfinite().all()), name


def test_it_was_trained_on_what_anybody_may_use(faces: Pix2Face) -> None:
    header = faces.predictor.header
    assert header.licence == "CC0-1.0"
    assert header.model_sha256 == faces.model.sha256


def test_its_landmarks_mirror_each_other(faces: Pix2Face) -> None:
    model = faces.model
    assert model.symmetry is not None
    assert {IBUG68, IBUG68_2D} <= set(model.landmarks)
    for scheme in (IBUG68, IBUG68_2D):
        vertices = model.landmarks[scheme]
        np.testing.assert_array_equal(model.symmetry[vertices], vertices[list(MIRRORS[scheme])])


def test_it_reads_a_photograph_found_by_the_detector(faces: Pix2Face) -> None:
    image = np.ascontiguousarray(astronaut())  # type: ignore[no-untyped-call]
    (fit,) = faces.fit(image)  # and nothing else in the picture, where the detector finds two faces more
    true = np.array(list(ASTRONAUT.values()))
    distances = np.linalg.norm(fit.landmarks2d[list(ASTRONAUT)] - true, axis=1) / 65  # of the outer eye distance
    assert distances.mean() < 0.08
    assert distances.max() < 0.16


@pytest.mark.parametrize("turn_deg", [40, -60, 90, 180])
def test_it_reads_tilted_faces_as_well_as_upright_ones(faces: Pix2Face, turn_deg: int) -> None:
    image = np.ascontiguousarray(astronaut())  # type: ignore[no-untyped-call]
    (upright,) = faces.fit(image)
    turn = cv2.getRotationMatrix2D((224, 130), turn_deg, 1)
    turned = cv2.warpAffine(image, turn, (512, 512))
    true = (upright.landmarks2d - 0.5) @ turn[:, :2].T + turn[:, 2] + 0.5
    (fit,) = faces.fit(turned, [FaceBox.around(true)])
    assert nme(fit.landmarks2d, true) < 0.03


def test_photographs_of_a_benchmark_are_read_as_well_as_the_docs_say(faces: Pix2Face, shared_dir: Path) -> None:
    errors = []
    for annotation in find_annotations(shared_dir / "data" / "aflw2000_3d" / "dev", IBUG68)[::10]:
        annotated = annotation.load()
        image, box = read_photograph(annotated.image_path), FaceBox.around(annotated.landmarks2d)
        (fit,) = faces.fit(image, [box])
        errors.append(nme(fit.landmarks2d, annotated.landmarks2d))
    assert len(errors) == 40
    assert np.median(errors) < 0.055
    assert np.mean(np.array(errors) > 0.1) <= 0.15


def test_landmarks_of_the_type_2d_are_nearer_to_those_that_people_mark(faces: Pix2Face, shared_dir: Path) -> None:
    types: tuple[LandmarkType, LandmarkType] = ("2d", "3d")
    errors: dict[LandmarkType, list[float]] = {landmark_type: [] for landmark_type in types}
    for annotation in find_annotations(shared_dir / "data" / "300w", IBUG68)[::3]:
        annotated = annotation.load()
        image, box = read_photograph(annotated.image_path), FaceBox.around(annotated.landmarks2d)
        (prediction,) = faces.predict(image, [box])
        for landmark_type in types:
            options = FitOptions(landmark_type=landmark_type)
            fit = faces.fit_prediction(prediction, (image.shape[0], image.shape[1]), options)
            own = landmark_errors(fit.landmarks2d, annotated.landmarks2d, "outer-eye")
            errors[landmark_type].append(float(own[list(INNER51)].mean()))
    assert len(errors["2d"]) == 10
    assert np.mean(errors["2d"]) < 0.9 * np.mean(errors["3d"])
