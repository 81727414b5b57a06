"""``Pix2Face``: photographs in, maps and fits out, whichever way they are asked for; and what it refuses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy import ndarray
from PIL import Image
from torch import Tensor

import pix2face
from pix2face import Pix2Face
from pix2face.detectors.detection import DetectedFace
from pix2face.errors import DegenerateGeometryError, InputFileError, ModelMismatchError, UsageError
from pix2face.files.images import read_photograph
from pix2face.geometry.crops import FaceBox
from pix2face.models.model_file import read_stored_model
from pix2face.models.morphable_model import MorphableModel, load_model
from tests.fits import paper_fit
from tests.model_files import write_small_head
from tests.pix2face.photographs.seen_faces import (
    HEIGHT_PX,
    PhotographedFace,
    SureDetector,
    exact_predictor,
    header_of,
    network_of,
    photographed_face,
    write_checkpoint,
    write_picture,
)
from tests.pix2face.stub_networks import predictor_of
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
EXACT = paper_fit(regularisation=1e-3)


@pytest.fixture(scope="module")
def face() -> PhotographedFace:
    return photographed_face(MODEL)


def seeing(*faces: PhotographedFace, refine: bool = False) -> Pix2Face:
    """Detects these faces in every photograph, and sees them exactly."""
    detector = SureDetector([face.box for face in faces])
    return Pix2Face(exact_predictor(MODEL, [face.maps() for face in faces]), MODEL, detector, refine)


def test_a_fit_is_in_the_pixels_of_the_photograph(face: PhotographedFace) -> None:
    (fit,) = seeing(face).fit(face.photograph(), options=EXACT)
    np.testing.assert_allclose(fit.landmarks2d, face.landmarks2d, atol=0.1)
    np.testing.assert_allclose(fit.identity, face.identity, atol=0.1)
    np.testing.assert_allclose(fit.camera.project(fit.landmarks3d), fit.landmarks2d, atol=1e-6)
    assert np.linalg.norm(fit.vertices - face.vertices, axis=1).max() < 0.5


def test_boxes_say_where_the_faces_are(face: PhotographedFace) -> None:
    blind = Pix2Face(exact_predictor(MODEL, [face.maps()]), MODEL, SureDetector([]))
    assert blind.fit(face.photograph()) == []
    assert blind.predict(face.photograph()) == []
    (fit,) = blind.fit(face.photograph(), [face.box], options=EXACT)
    np.testing.assert_allclose(fit.landmarks2d, face.landmarks2d, atol=0.1)


def test_a_batch_is_its_photographs_one_by_one() -> None:
    torch.manual_seed(0)
    network = torch.nn.Conv2d(3, 6, 3, padding=1)
    both = Pix2Face(predictor_of(network, header_of(MODEL, 32)), None, SureDetector([]))
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (40 + 9 * k, 50, 3)).astype(np.uint8) for k in range(3)]
    boxes = [[FaceBox(5, 5, 30, 40), FaceBox(1, 2, 20, 22)], [], [FaceBox(10, 10, 45, 40)]]
    together = both.predict_batch(images, boxes)
    assert [len(own) for own in together] == [2, 0, 1]
    for image, own, predictions in zip(images, boxes, together, strict=True):
        for alone, prediction in zip(both.predict(image, own), predictions, strict=True):
            np.testing.assert_allclose(prediction.maps.pncc, alone.maps.pncc, atol=1e-3)
            np.testing.assert_array_equal(prediction.crop.image_from_crop, alone.crop.image_from_crop)
    assert both.predict_batch([]) == []


def test_many_faces_go_through_the_network_in_portions() -> None:
    sizes = []

    def network(images: Tensor) -> Tensor:
        sizes.append(len(images))
        return torch.zeros(len(images), 6, 32, 32)

    crowd = Pix2Face(predictor_of(network, header_of(MODEL, 32)), None)
    image = np.zeros((50, 60, 3), dtype=np.uint8)
    assert len(crowd.predict(image, [FaceBox(10, 10, 40, 40)] * 37)) == 37
    assert sizes == [16, 16, 5]


def test_a_joint_fit_has_one_identity_and_an_expression_for_each_photograph() -> None:
    first = photographed_face(MODEL, 0)
    second = replace(photographed_face(MODEL, 7, (120, 115)), identity=first.identity)
    maps, images = [first.maps(), second.maps()], [first.photograph(), second.photograph()]
    person = Pix2Face(predictor_of(network_of(maps), header_of(MODEL)), MODEL)
    fits = person.fit_joint(images, [first.box, second.box], options=EXACT)
    np.testing.assert_array_equal(fits[0].identity, fits[1].identity)
    for fit, face in zip(fits, (first, second), strict=True):
        np.testing.assert_allclose(fit.identity, face.identity, atol=0.1)
        np.testing.assert_allclose(fit.expression, face.expression, atol=0.1)
        np.testing.assert_allclose(fit.landmarks2d, face.landmarks2d, atol=0.15)


def test_a_joint_fit_takes_the_largest_face_and_names_the_photograph_without_one(face: PhotographedFace) -> None:
    small = FaceBox(5, 5, 20, 20)
    found = Pix2Face(exact_predictor(MODEL, [face.maps()]), MODEL, SureDetector([face.box, small]), refine=False)
    (fit,) = found.fit_joint([face.photograph()], options=EXACT)
    np.testing.assert_allclose(fit.landmarks2d, face.landmarks2d, atol=0.1)
    with pytest.raises(DegenerateGeometryError, match="no face found in photograph 0"):
        Pix2Face(exact_predictor(MODEL, [face.maps()]), MODEL, SureDetector([])).fit_joint([face.photograph()])


def test_refining_corrects_the_box_of_a_detector(face: PhotographedFace) -> None:
    """The stub sees the face as it is in the crop of the true box, whatever it is shown: the box is then that one."""
    (refined,) = seeing(face, refine=True).find_faces(face.photograph())
    assert np.abs(sides(refined.box) - sides(face.box)).max() < 1.5
    (unrefined,) = seeing(face).find_faces(face.photograph())
    assert unrefined == DetectedFace(face.box, 1.0)


def test_box_and_score_go_through_to_the_fit(face: PhotographedFace) -> None:
    image, shifted = face.photograph(), FaceBox(*(sides(face.box) + 1).tolist())
    pix2face = Pix2Face(exact_predictor(MODEL, [face.maps()]), MODEL, SureDetector([face.box]), refine=False)
    for boxes, expected in (
        (None, (face.box, 1.0)),
        ([shifted], (shifted, None)),
        ([DetectedFace(shifted, 0.4)], (shifted, 0.4)),
    ):
        (prediction,), (fit,) = pix2face.predict(image, boxes), pix2face.fit(image, boxes, EXACT)
        (joint,) = pix2face.fit_joint([image], boxes, EXACT)
        for own in (prediction, fit, joint):
            assert (own.box, own.score) == expected
    strict = Pix2Face(
        exact_predictor(MODEL, [face.maps()]), MODEL, SureDetector([face.box]), refine=False, min_score=1.1
    )
    assert strict.find_faces(image) == []


def sides(box: FaceBox) -> ndarray:
    return np.array([box.left, box.top, box.right, box.bottom])


def test_photographs_and_boxes_are_taken_as_callers_have_them(face: PhotographedFace, tmp_path: Path) -> None:
    path = write_picture(tmp_path / "person.png", face.photograph())
    given = [path, str(path), Image.open(path), face.photograph()]
    box = tuple(float(side) for side in sides(face.box))
    seen = seeing(face)
    assert all(seen.find_faces(image) == [DetectedFace(face.box, 1.0)] for image in given)
    (expected,) = seen.fit(face.photograph(), [face.box], options=EXACT)
    for image in given:
        for fit in (*seen.fit(image, [box], EXACT), *seen.fit_joint([image], [box], EXACT)):
            np.testing.assert_allclose(fit.landmarks2d, expected.landmarks2d, atol=0.1)
        ((prediction,),) = seen.predict_batch([image], [np.array([box])])
        np.testing.assert_array_equal(prediction.maps.pncc, seen.predict(path, [face.box])[0].maps.pncc)
    with pytest.raises(InputFileError, match="found no such file"):
        seen.fit(tmp_path / "mistyped.png")


def test_boxes_for_other_photographs_are_refused(face: PhotographedFace) -> None:
    with pytest.raises(UsageError, match="boxes for each of 1 photographs, found 2"):
        seeing(face).predict_batch([face.photograph()], [[face.box], []])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("plane", [0, 5])
def test_a_network_that_says_nothing_finite_is_named(face: PhotographedFace, value: float, plane: int) -> None:
    whole = network_of([face.maps()])

    def broken(images: Tensor) -> Tensor:
        planes = whole(images).clone()
        planes[:, plane, 60:64] = value
        return planes

    damaged = Pix2Face(predictor_of(broken, header_of(MODEL)), MODEL)
    for ask in (damaged.predict, damaged.fit):
        with pytest.raises(DegenerateGeometryError, match=r"expected finite maps from the network, found 512 of"):
            ask(face.photograph(), [face.box])


def test_a_network_that_sees_nothing_is_told_from_a_broken_one(face: PhotographedFace) -> None:
    nothing = Pix2Face(predictor_of(lambda images: torch.zeros(len(images), 6, 128, 128), header_of(MODEL)), MODEL)
    (prediction,) = nothing.predict(face.photograph(), [face.box])
    assert not prediction.maps.mask.any()
    with pytest.raises(DegenerateGeometryError, match="found only background"):
        nothing.fit(face.photograph(), [face.box])


def test_a_tiny_face_and_one_cut_by_the_border_have_maps(face: PhotographedFace) -> None:
    image = face.photograph()
    for box in (FaceBox(100, 100, 103, 103), FaceBox(-60, -50, 40, 60), FaceBox(200, 150, 420, 400)):
        (prediction,) = seeing(face).predict(image, [box])
        assert prediction.maps.mask.any()
        (fit,) = seeing(face).fit(image, [box])
        assert np.isfinite(fit.landmarks2d).all()


def test_the_model_must_be_the_network_s(face: PhotographedFace) -> None:
    other = replace(MODEL, name="another head", sha256="1" * 64)
    with pytest.raises(ModelMismatchError, match=r"small synthetic head.*another head"):
        Pix2Face(exact_predictor(MODEL, [face.maps()]), other)


def test_maps_need_no_model(face: PhotographedFace) -> None:
    without = Pix2Face(exact_predictor(MODEL, [face.maps()]), None, SureDetector([face.box]))
    (prediction,) = without.predict(face.photograph())
    assert prediction.maps.mask.any()
    with pytest.raises(UsageError, match="expected a morphable model to fit, found none"):
        without.fit(face.photograph())


def test_it_is_loaded_from_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model_path = write_small_head(tmp_path / "head.h5")
    model = load_model(model_path)
    assert model.sha256 == read_stored_model(model_path)[1]
    checkpoint = write_checkpoint(tmp_path / "runs" / "one" / "checkpoint.safetensors", model)
    image = np.zeros((HEIGHT_PX, 260, 3), dtype=np.uint8)
    by_name = Pix2Face.load(str(checkpoint), str(model_path), "cpu")
    by_path = Pix2Face.load(checkpoint, model_path, "cpu")
    monkeypatch.setattr("pix2face.api.PACKAGED", checkpoint)
    by_default = Pix2Face.load(model=model)
    for loaded in (by_name, by_path, by_default):
        assert isinstance(loaded.model, MorphableModel)
        assert len(loaded.predict(image, [FaceBox(20, 20, 120, 120)])) == 1
    with pytest.raises(UsageError, match="nonsense"):
        Pix2Face.load(checkpoint, model, "nonsense")
    with pytest.raises(UsageError, match="expected a detector of"):
        Pix2Face.load(checkpoint, model, detector="nonsense")
    with pytest.raises(UsageError, match="the smallest face as a share"):
        Pix2Face.load(checkpoint, model, smallest_face=2.0)


def test_the_package_names_it_and_nothing_else() -> None:
    assert pix2face.Pix2Face is Pix2Face
    with pytest.raises(AttributeError, match="no attribute 'Pix3Face'"):
        _ = pix2face.Pix3Face


def test_the_example_runs(tmp_path: Path, face: PhotographedFace, monkeypatch: pytest.MonkeyPatch) -> None:
    from examples.fit_photograph import main

    photograph = write_picture(tmp_path / "person.png", face.photograph())
    monkeypatch.setattr(Pix2Face, "load", lambda checkpoint=None: seeing(face))
    main(photograph, None, tmp_path / "out")
    landmarks = np.loadtxt(tmp_path / "out" / "landmarks-0.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(landmarks, face.landmarks2d, atol=1)
    assert read_photograph(tmp_path / "out" / "landmarks.png").shape == face.photograph().shape
