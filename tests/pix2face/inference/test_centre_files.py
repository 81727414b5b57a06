"""Files of the detector's network."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from skimage.data import astronaut

from pix2face.commands.cli import main
from pix2face.detectors.centre_detector import PACKAGED as PACKAGED_DETECTOR
from pix2face.detectors.detection import open_detector
from pix2face.errors import InputFileError
from pix2face.inference import PACKAGED
from pix2face.inference.centre_files import DetectorHeader, export_detector, load_detector
from training.detection.centre_network import CentreNetwork
from training.detection.detector_files import load_centre_network, save_detector

HEADER = DetectorHeader(licence="CC0-1.0", configuration="{}", samples=64)


def trained() -> CentreNetwork:
    """A network whose norms are not those of the start."""
    torch.manual_seed(1)
    network = CentreNetwork()
    for _ in range(2):
        network.train()(torch.rand(2, 3, 64, 64))
    return network.eval()


def test_a_file_answers_what_torch_does_for_any_size_and_number_of_pictures(tmp_path: Path) -> None:
    network = trained()
    for name, precision in (("single", torch.float32), ("half", torch.float16)):
        save_detector(tmp_path / f"{name}.safetensors", HEADER, network, precision)
    assert (tmp_path / "half.safetensors").stat().st_size < 2_000_000
    header, answers = load_detector(tmp_path / "single.safetensors")
    _, half_answers = load_detector(tmp_path / "half.safetensors")
    assert header == HEADER
    for shape in ((2, 64, 96, 3), (1, 160, 32, 3)):
        pictures = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
        with torch.no_grad():
            batch = torch.from_numpy(pictures).permute(0, 3, 1, 2) / 255 - 0.5
            expected = network(batch).permute(0, 2, 3, 1).numpy()
        assert expected.shape == (len(pictures), shape[1] // 8, shape[2] // 8, 5)
        np.testing.assert_allclose(answers(pictures), expected, atol=1e-4)
        np.testing.assert_allclose(half_answers(pictures), expected, atol=0.02)


def test_a_network_comes_back_from_its_file(tmp_path: Path) -> None:
    network = trained()
    save_detector(tmp_path / "c.safetensors", HEADER, network, torch.float32)
    loaded = load_centre_network(tmp_path / "c.safetensors").state_dict()
    for name, own in network.state_dict().items():
        torch.testing.assert_close(loaded[name], own, rtol=0, atol=0)


def test_the_packaged_detector_as_onnx_finds_the_same(tmp_path: Path) -> None:
    path = tmp_path / "detector.onnx"
    assert main(["export", "--detector", "--out", str(path)]) == 0
    onnx.checker.check_model(onnx.load(str(path)), full_check=True)
    assert load_detector(path)[0] == load_detector(PACKAGED_DETECTOR)[0]
    picture = astronaut()[:256, 94:350]
    found, expected = open_detector(str(path)).candidates(picture), open_detector().candidates(picture)
    assert found == expected
    assert found[0].score > 1
    assert len(export_detector(PACKAGED_DETECTOR, half=True)) < 0.6 * path.stat().st_size


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="expected pix2face-detector in the metadata"):
        load_detector(PACKAGED)
    with pytest.raises(InputFileError, match="no such file"):
        load_detector(tmp_path / "missing.safetensors")
    path = tmp_path / "wrong.safetensors"
    save_detector(path, replace(HEADER, neck=16), CentreNetwork(), torch.float32)
    for load in (load_detector, load_centre_network):
        with pytest.raises(InputFileError, match=r"do not make a detector"):
            load(path)
    save_detector(path, replace(HEADER, neck=0), CentreNetwork(), torch.float32)
    with pytest.raises(InputFileError, match=r"do not make a detector .*>= 1"):
        load_detector(path)
    save_detector(path, replace(HEADER, schema_version=99), CentreNetwork(), torch.float32)
    with pytest.raises(InputFileError, match=r"schema 99 is newer"):
        load_detector(path)
    (tmp_path / "wrong.onnx").write_bytes(b"no network")
    with pytest.raises(InputFileError, match=r"wrong\.onnx: expected an ONNX file"):
        load_detector(tmp_path / "wrong.onnx")
