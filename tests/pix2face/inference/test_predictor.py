import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from pix2face.errors import UsageError
from pix2face.geometry.camera import affine_camera
from pix2face.geometry.crops import FaceBox, crop_image, square_crop
from pix2face.inference.answers import Answers
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.predictor import Predictor
from pix2face.inference.torch_networks import TorchNetwork, save_checkpoint
from pix2face.networks.dimensions import paper_widths, residual_widths
from pix2face.networks.paper import UNet
from pix2face.networks.residual import ResidualUNet
from tests.pix2face.stub_networks import predictor_of

HEADER = CheckpointHeader(
    model_name="small head",
    model_sha256="a" * 64,
    size_px=32,
    widths=paper_widths(32, 4),
    pncc_scale_mm=120.0,
    offset_scale_mm=20.0,
    smallest_radius_mm=60.0,
    licence="CC0-1.0",
    configuration="{}",
    epoch=1,
)
BOX = FaceBox(20, 30, 80, 90)


def disc_network(image: Tensor) -> Tensor:
    """Says that a disc in the middle is face, at PNCC (0, 0, 0.75) and offset (the picture)."""
    size = image.shape[-1]
    row, column = torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij")
    inside = ((row - size / 2) ** 2 + (column - size / 2) ** 2 < (size / 3) ** 2).float()
    pncc = torch.stack([0 * inside, 0 * inside, 0.75 * inside]).expand(len(image), 3, size, size)
    return torch.cat([pncc, image], dim=1)


def picture(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, size=(100, 110, 3)).astype(np.uint8)


def test_planes_become_millimetres_inside_the_mask_and_zero_outside():
    prediction = predictor_of(disc_network, HEADER).predict(picture(), BOX)
    maps = prediction.maps
    assert 0.2 < maps.mask.mean() < 0.35
    np.testing.assert_allclose(maps.pncc[maps.mask], np.tile([0, 0, 90.0], (maps.mask.sum(), 1)))
    assert not maps.pncc[~maps.mask].any()
    assert not maps.offset[~maps.mask].any()
    # The stub hands its input through as offset: it must be the crop, from -0.5 to 0.5, in RGB order.
    crop = square_crop(BOX, 1.4, 32)
    np.testing.assert_array_equal(prediction.crop.image_from_crop, crop.image_from_crop)
    expected = (crop_image(picture(), crop).astype(np.float32) / 255 - 0.5) * 20
    np.testing.assert_allclose(maps.offset[maps.mask], expected[maps.mask], atol=1e-5)


def test_the_threshold_is_half_the_smallest_radius():
    def constant(value: float) -> Predictor:
        return predictor_of(lambda image: torch.full((len(image), 6, 32, 32), value / 120.0), HEADER)

    radius = 30 / np.sqrt(3)
    # The border of the picture is none of the face.
    assert constant(radius * 1.01).predict(picture(), BOX).maps.mask.all()
    assert not constant(radius * 0.99).predict(picture(), BOX).maps.mask.any()
    assert not constant(float("nan")).predict(picture(), BOX).maps.mask.any()


def test_maps_say_where_the_photograph_has_ended():
    predict = predictor_of(disc_network, HEADER).predict
    assert predict(picture(), FaceBox(20, 20, 80, 80)).maps.in_photograph is None
    shown = predict(picture(), FaceBox(70, 30, 130, 90)).maps.in_photograph
    assert shown is not None
    assert shown[:, 0].any()
    assert not shown[:, -1].any()


def test_a_network_that_knows_its_masks_is_believed():
    def with_masks(image: Tensor) -> Tensor:
        size = image.shape[-1]
        column = torch.arange(size).expand(len(image), 1, size, size).float()
        everywhere = torch.full((len(image), 6, size, size), 1e-3)  # far below the radius: as background
        return torch.cat([everywhere, 20 - column, column - 9], dim=1)

    predict = predictor_of(with_masks, replace(HEADER, planes=8)).predict
    prediction = predict(picture(), BOX)
    columns = np.flatnonzero(prediction.maps.mask.any(axis=0))
    assert (columns.min(), columns.max()) == (0, 18)  # below 20, eroded by one pixel where the face ends
    assert prediction.maps.seen is not None
    columns = np.flatnonzero(prediction.maps.seen.any(axis=0))
    assert (columns.min(), columns.max()) == (10, 18)
    assert (
        predictor_of(lambda image: with_masks(image)[:, :7], replace(HEADER, planes=7))
        .predict(picture(), BOX)
        .maps.seen
        is None
    )


def test_a_batch_is_the_same_as_its_faces_one_by_one():
    torch.manual_seed(2)
    predictor = Predictor(TorchNetwork(UNet(32, 4)), HEADER)
    faces = [(picture(0), BOX), (picture(1)[:70], FaceBox(5, 5, 40, 60)), (picture(0), FaceBox(0, 0, 110, 100))]
    batch = predictor.predict_batch(faces)
    for together, (image, box) in zip(batch, faces, strict=True):
        alone = predictor.predict(image, box)
        np.testing.assert_array_equal(together.crop.image_from_crop, alone.crop.image_from_crop)
        np.testing.assert_allclose(together.maps.pncc, alone.maps.pncc, atol=1e-3)
        np.testing.assert_array_equal(together.maps.mask, alone.maps.mask)
    assert predictor.predict_batch([]) == []


class LeaningNetwork:
    """Says of each picture that its head leans to the right by so much (radians), whatever it shows."""

    def __init__(self, *tilts: float) -> None:
        self.tilts, self.batches = tilts, []
        self.numbers = np.random.default_rng(0).uniform(-0.3, 0.3, (68, 3)).astype(np.float32)

    def answers(self, pictures: np.ndarray) -> Answers:
        self.batches.append(pictures)
        right, down = np.meshgrid(*2 * [np.linspace(-0.3, 0.3, pictures.shape[1])])
        planes = []
        for tilt in self.tilts[: len(pictures)]:
            cos, sin = np.cos(tilt), np.sin(tilt)
            pncc = np.stack([right * cos + down * sin, right * sin - down * cos, 0.75 - right**2 - down**2], axis=-1)
            planes.append(np.concatenate([pncc, 0 * pncc], axis=-1))
        return Answers(np.array(planes, dtype=np.float32), self.landmarks(pictures))

    def landmarks(self, pictures: np.ndarray) -> np.ndarray:
        return np.repeat(self.numbers[None], len(pictures), axis=0)


@pytest.mark.parametrize("tilt_deg", [0, 20, -20, 30, -45, 90, 179])
def test_tilted_faces_are_predicted_again_in_upright_crops(tilt_deg):
    network = LeaningNetwork(np.radians(tilt_deg))
    prediction = Predictor(network, replace(HEADER, n_landmarks=68)).predict(picture(), BOX)
    first = square_crop(BOX, 1.4, 32)
    if abs(tilt_deg) <= 20:
        np.testing.assert_array_equal(prediction.crop.image_from_crop, first.image_from_crop)
        assert len(network.batches) == 1
        return
    across = prediction.crop.image_from_crop[:2, 0]
    assert np.degrees(np.arctan2(across[1], across[0])) == pytest.approx(tilt_deg, abs=1)
    assert not prediction.crop.is_mirrored
    around = FaceBox.around(prediction.crop.to_crop(first.to_image(32 * (network.numbers[:, :2] + 0.5))))
    np.testing.assert_allclose(around.centre, 16)
    assert around.longer_side == pytest.approx(32 / 1.4)
    shown = (crop_image(picture(), prediction.crop).astype(np.float32) / 255 - 0.5)[None]
    np.testing.assert_array_equal(network.batches[1], shown)


@pytest.mark.parametrize("more_deg", [0, -10, 60])
def test_a_face_whose_box_tells_its_turn_is_upright_in_both_crops(more_deg):
    """It may be tilted by somewhat more than its box says."""
    network, box = LeaningNetwork(np.radians(more_deg)), replace(BOX, turn_deg=135.0)
    prediction = Predictor(network, replace(HEADER, n_landmarks=68)).predict(picture(), box)
    first = square_crop(BOX, 1.4, 32, rotation=np.deg2rad(135))
    shown = (crop_image(picture(), first).astype(np.float32) / 255 - 0.5)[None]
    np.testing.assert_array_equal(network.batches[0], shown)
    assert len(network.batches) == 2
    across = prediction.crop.image_from_crop[:2, 0]
    turn_deg = np.degrees(np.arctan2(across[1], across[0]))
    assert (turn_deg - 135 - more_deg + 180) % 360 == pytest.approx(180, abs=1)
    assert prediction.box == box


def test_of_a_batch_only_tilted_faces_are_predicted_again():
    network = LeaningNetwork(0.0, 1.0, 0.1)
    faces = [(picture(seed), BOX) for seed in range(3)]
    crops = [
        own.crop.image_from_crop for own in Predictor(network, replace(HEADER, n_landmarks=68)).predict_batch(faces)
    ]
    assert [len(batch) for batch in network.batches] == [3, 1]
    assert [bool(crop[0, 1]) for crop in crops] == [False, True, False]


@pytest.fixture
def checkpoint(tmp_path):
    """A network that corrects fits."""
    torch.manual_seed(0)
    widths = residual_widths(4)
    network = ResidualUNet(widths, landmarks=68, corrected=3).eval()
    torch.nn.init.normal_(network.correction.second.weight)
    header = replace(HEADER, architecture="residual", size_px=64, widths=widths, n_landmarks=68, n_corrected=3)
    save_checkpoint(tmp_path / "c.safetensors", header, network)
    return tmp_path / "c.safetensors"


CAMERA, COEFFICIENTS = affine_camera(np.array([[0.3, 0, 0, 30.0], [0, -0.3, 0, 34.0]])), np.array([0.5, -1, 2])


def test_torch_and_onnxruntime_predict_the_same(checkpoint, monkeypatch):
    monkeypatch.setattr("pix2face.inference.predictor.TILTED_RAD", np.pi)  # the maps of random weights lean anywhere
    by_onnx, by_torch = (Predictor.load(checkpoint, device).predict(picture(), BOX) for device in ("cpu", "cpu:0"))
    np.testing.assert_allclose(by_onnx.maps.pncc, by_torch.maps.pncc, atol=1e-2)
    np.testing.assert_allclose(by_onnx.maps.landmarks.points2d, by_torch.maps.landmarks.points2d, atol=1e-3)
    (found, changed), (expected, own) = (one.maps.correct(CAMERA, COEFFICIENTS) for one in (by_onnx, by_torch))
    np.testing.assert_allclose(found.matrix, expected.matrix, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(changed, own, rtol=1e-4, atol=1e-4)


def test_torch_is_needed_for_named_devices_only(checkpoint, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "pix2face.inference.torch_networks")
    monkeypatch.setattr("pix2face.inference.predictor.GPU_DRIVERS", [Path("/")])  # as if there were a GPU
    assert Predictor.load(checkpoint).predict(picture(), BOX).maps.pncc.any()
    with pytest.raises(
        UsageError, match=r"--device cpu, or PyTorch, which 'cuda' needs; run: pip install 'pix2face\[t"
    ):
        Predictor.load(checkpoint, "cuda")


def test_each_face_of_a_batch_has_its_own_correction(checkpoint):
    predictor = Predictor.load(checkpoint, "cpu")
    faces = [(picture(seed), BOX) for seed in range(2)]
    together = [prediction.maps.correct(CAMERA, COEFFICIENTS) for prediction in predictor.predict_batch(faces)]
    alone = [predictor.predict(*face).maps.correct(CAMERA, COEFFICIENTS) for face in faces]
    for (found, changed), (expected, own) in zip(together, alone, strict=True):
        np.testing.assert_allclose(found.matrix, expected.matrix, rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(changed, own, rtol=1e-4, atol=1e-5)
    assert np.abs(together[0][1] - together[1][1]).max() > 1e-3
    assert np.abs(together[0][0].matrix - CAMERA.matrix).max() > 1e-3
    assert predictor_of(disc_network, HEADER).predict(picture(), BOX).maps.correct is None
