"""Files of the detector's network."""

from pathlib import Path

import numpy as np
import pytest
import torch
from skimage.data import astronaut

from pix2face.detectors.centre_detector import PACKAGED as PACKAGED_DETECTOR
from pix2face.detectors.detection import open_detector
from pix2face.errors import InputFileError
from pix2face.inference import PACKAGED
from pix2face.inference.centre_files import DetectorHeader, load_centre_network, load_detector, runner, save_detector
from pix2face.networks.centre import CentreNetwork

HEADER = DetectorHeader(licence="CC0-1.0", configuration="{}", samples=64)


def test_a_network_comes_back_from_its_file(tmp_path: Path) -> None:
    torch.manual_seed(1)
    network = CentreNetwork()
    save_detector(tmp_path / "single.safetensors", HEADER, network, torch.float32)
    save_detector(tmp_path / "half.safetensors", HEADER, network, torch.float16)
    assert (tmp_path / "half.safetensors").stat().st_size < 2_000_000
    header, answers = load_detector(tmp_path / "single.safetensors")
    assert header == HEADER
    pictures = np.random.default_rng(0).integers(0, 256, (2, 64, 96, 3), dtype=np.uint8)
    expected = runner(network)(pictures)
    assert expected.shape == (2, 8, 12, 5)
    np.testing.assert_allclose(answers(pictures), expected, atol=1e-5)
    np.testing.assert_allclose(load_detector(tmp_path / "half.safetensors")[1](pictures), expected, atol=0.02)


@pytest.mark.xdist_group("packaged detector as onnx")
def test_onnx_answers_the_same_for_any_size_and_number_of_pictures(detector_onnx: Path) -> None:
    path, rng = detector_onnx, np.random.default_rng(2)
    (own_header, own), (header, answers) = load_detector(PACKAGED_DETECTOR), load_detector(path)
    assert header == own_header
    for shape in ((1, 64, 96, 3), (3, 160, 32, 3)):
        pictures = rng.integers(0, 256, shape, dtype=np.uint8)
        np.testing.assert_allclose(answers(pictures), own(pictures), atol=1e-3)
    picture = astronaut()[:256, 94:350]
    found, expected = open_detector(str(path)).candidates(picture), open_detector().candidates(picture)
    assert [face.score for face in found] == pytest.approx([face.score for face in expected], abs=1e-3)
    assert found[0].score > 1


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="expected pix2face-detector in the safetensors header"):
        load_detector(PACKAGED)
    with pytest.raises(InputFileError, match="no such file"):
        load_detector(tmp_path / "missing.safetensors")
    path = tmp_path / "wrong.safetensors"
    save_detector(path, DetectorHeader(**{**vars(HEADER), "neck": 16}), CentreNetwork(), torch.float32)
    with pytest.raises(InputFileError, match="do not make a detector"):
        load_centre_network(path)
