"""Networks as ONNX compute what torch computes, for any batch, and their files carry all that a user needs."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from pix2face.commands.cli import main
from pix2face.errors import InputFileError, UsageError
from pix2face.geometry.crops import FaceBox
from pix2face.inference.checkpoint import METADATA_KEY, CheckpointHeader
from pix2face.inference.onnx_files import export_onnx, export_parts, load_onnx, open_network
from pix2face.inference.onnx_networks import INPUT_NAME, OUTPUT_NAME
from pix2face.inference.predictor import Predictor
from pix2face.inference.torch_networks import TorchNetwork, load_checkpoint, save_checkpoint
from pix2face.networks import SCALE_PLANE
from pix2face.networks.blocks import BoundedBatchNorm
from pix2face.networks.dimensions import residual_widths
from pix2face.networks.residual import ResidualUNet
from tests.full_disk import FULL, files_of_at_most
from tests.pix2face.photographs.seen_faces import header_of, write_checkpoint
from tests.synthetic_models import small_head_model


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_checkpoint(tmp_path_factory.mktemp("run") / "checkpoint.safetensors", small_head_model())


@pytest.fixture(scope="module")
def exported(checkpoint: Path) -> Path:
    path = checkpoint.parent / "network.onnx"
    assert main(["export", "--checkpoint", str(checkpoint), "--out", str(path)]) == 0
    return path


def test_it_computes_what_torch_computes_for_any_batch(checkpoint: Path, exported: Path) -> None:
    header, network = load_checkpoint(checkpoint)
    session = onnxruntime.InferenceSession(str(exported), providers=["CPUExecutionProvider"])
    for n in (1, 2, 5):
        images = np.random.default_rng(n).uniform(-0.5, 0.5, (n, 3, header.size_px, header.size_px)).astype(np.float32)
        with torch.inference_mode():
            expected = network(torch.from_numpy(images)).numpy()
        (found,) = session.run([OUTPUT_NAME], {INPUT_NAME: images})
        assert found.shape == (n, 6, header.size_px, header.size_px)
        assert np.abs(found - expected).max() <= 1e-4 * np.ptp(expected)


def residual_checkpoint(folder: Path, size_px: int, *, planes: int = 9, inner_variance: float = 1e-3) -> Path:
    """A network in float16, as releases are, all of whose weights count. Its innermost norms reach their bounds."""
    torch.manual_seed(0)
    widths = residual_widths(2)
    network = ResidualUNet(widths, planes, 68, corrected=5)
    for _ in range(3):
        network(torch.rand(4, 3, size_px, size_px) - 0.5)  # norms with statistics of their own
    for part in network.modules():
        if isinstance(part, torch.nn.BatchNorm2d | torch.nn.BatchNorm1d) and part.affine:
            torch.nn.init.uniform_(part.weight, 0.5, 1.5)
            torch.nn.init.normal_(part.bias)
        if isinstance(part, BoundedBatchNorm):
            part.running_var.mul_(inner_variance)
    for answer in network.coarse_planes:
        torch.nn.init.normal_(answer.weight, std=0.1)
    numbers = {"architecture": "residual", "widths": widths, "planes": planes, "n_landmarks": 68, "n_corrected": 5}
    save_checkpoint(
        folder / "c.safetensors", replace(header_of(small_head_model(), size_px), **numbers), network, torch.float16
    )
    return folder / "c.safetensors"


def pictures_of(header: CheckpointHeader, n: int = 3) -> np.ndarray:
    return np.random.default_rng(n).uniform(-0.5, 0.5, (n, header.size_px, header.size_px, 3)).astype(np.float32)


def difference(found: np.ndarray | None, expected: np.ndarray | None) -> float:
    """The largest, as a share of the range."""
    assert found is not None
    assert expected is not None
    assert found.shape == expected.shape
    return float(np.abs(found - expected).max() / np.ptp(expected))


# At 64 px the innermost features are averaged to more places than they have pixels; at 192 px bins overlap.
@pytest.mark.parametrize(("size_px", "planes"), [(64, 9), (128, 6), (192, 8)])
def test_the_residual_network_answers_what_torch_does(tmp_path: Path, size_px: int, planes: int) -> None:
    path = residual_checkpoint(tmp_path, size_px, planes=planes)
    header, network = load_checkpoint(path)
    own_header, run, correction = open_network(path)
    pictures = pictures_of(header)
    found, expected = run.answers(pictures), TorchNetwork(network).answers(pictures)
    assert own_header == header
    assert correction is not None
    # Small variances of the innermost norms enlarge what is rounded.
    assert difference(found.planes, expected.planes[..., :SCALE_PLANE]) < 1e-3
    assert difference(found.landmarks, expected.landmarks) < 1e-3
    assert difference(found.seen, expected.seen) < 1e-3
    alone = run.answers(pictures[1:2])
    np.testing.assert_array_equal(alone.planes[0], found.planes[1])


def test_the_test_above_reaches_the_bounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    header, network = load_checkpoint(residual_checkpoint(tmp_path, 64))
    within = TorchNetwork(network).answers(pictures_of(header))
    monkeypatch.setattr("pix2face.networks.blocks.FARTHEST", 1e6)
    assert difference(TorchNetwork(network).answers(pictures_of(header)).planes, within.planes) > 0.01


def test_a_file_has_all_planes_and_no_correction(tmp_path: Path) -> None:
    path = residual_checkpoint(tmp_path, 64)
    header, content = export_onnx(path)
    (tmp_path / "network.onnx").write_bytes(content)
    found_header, run = load_onnx(tmp_path / "network.onnx")
    _, network = load_checkpoint(path)
    assert header == found_header
    assert header.n_corrected == 0
    pictures = pictures_of(header)
    found, expected = run.answers(pictures), TorchNetwork(network).answers(pictures)
    assert difference(found.planes, expected.planes) < 1e-3
    assert difference(found.landmarks, expected.landmarks) < 1e-3
    assert found.seen is None


def test_a_file_with_half_the_bytes_computes_nearly_the_same(checkpoint: Path) -> None:
    header, whole = export_onnx(checkpoint)
    _, (half,) = export_parts(checkpoint)
    onnx.checker.check_model(onnx.load_from_string(half), full_check=True)
    assert len(half) < 0.6 * len(whole)
    images = pictures_of(header).transpose(0, 3, 1, 2)
    found, expected = (
        onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"]).run(None, {INPUT_NAME: images})[0]
        for content in (half, whole)
    )
    assert 1e-5 < difference(found, expected) < 1e-2


def test_two_files_one_after_the_other_compute_what_the_network_does(tmp_path: Path) -> None:
    path = residual_checkpoint(tmp_path, 64)
    header, parts = export_parts(path)
    encoder, decoder = (onnxruntime.InferenceSession(part, providers=["CPUExecutionProvider"]) for part in parts)
    pictures = pictures_of(header)
    names = [output.name for output in encoder.get_outputs()]
    first = dict(zip(names, encoder.run(None, {INPUT_NAME: pictures.transpose(0, 3, 1, 2)}), strict=True))
    maps = decoder.run([OUTPUT_NAME], {own.name: first[own.name] for own in decoder.get_inputs()})[0]
    expected = TorchNetwork(load_checkpoint(path)[1]).answers(pictures)
    assert difference(first["landmarks"], expected.landmarks) < 1e-2
    assert difference(maps.transpose(0, 2, 3, 1), expected.planes[..., :SCALE_PLANE]) < 1e-2


def test_it_is_a_valid_file_that_says_what_it_is(checkpoint: Path, exported: Path) -> None:
    model = onnx.load(str(exported))
    onnx.checker.check_model(model, full_check=True)
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    header = json.loads(metadata[METADATA_KEY])
    assert header["model_sha256"] == small_head_model().sha256
    assert (header["pncc_scale_mm"], header["offset_scale_mm"], header["size_px"]) == (150.0, 20.0, 32)
    assert "pncc_scale_mm" in model.doc_string
    assert [path.name for path in exported.parent.iterdir() if path.suffix not in (".onnx", ".safetensors")] == []


def test_it_predicts_what_the_checkpoint_predicts(checkpoint: Path, exported: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (70, 80, 3)).astype(np.uint8)
    box = FaceBox(20, 10, 60, 55)
    found, expected = (Predictor.load(path, "cpu").predict(image, box) for path in (exported, checkpoint))
    np.testing.assert_array_equal(found.maps.pncc, expected.maps.pncc)
    np.testing.assert_array_equal(found.crop.image_from_crop, expected.crop.image_from_crop)


def test_another_device_than_the_cpu_is_refused_not_ignored(exported: Path) -> None:
    with pytest.raises(UsageError, match="expected --device cpu, where ONNX files run here, found 'cuda'"):
        Predictor.load(exported, "cuda")


@pytest.mark.parametrize("content", [b"", b"no network", b"\x08\x07\x12\x07pytorch"])
def test_what_is_no_network_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.onnx"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=r"broken\.onnx: expected"):
        load_onnx(path)
    with pytest.raises(InputFileError, match=r"nothing\.onnx: no such file"):
        load_onnx(tmp_path / "nothing.onnx")


def test_a_network_of_somebody_else_is_named(exported: Path, tmp_path: Path) -> None:
    model = onnx.load(str(exported))
    del model.metadata_props[:]
    onnx.save(model, str(tmp_path / "foreign.onnx"))
    with pytest.raises(
        InputFileError, match=r"foreign\.onnx: expected pix2face-checkpoint in the metadata, found none"
    ):
        load_onnx(tmp_path / "foreign.onnx")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size_px": 64}, "expected the paper's widths for 64 px"),
        ({"planes": 7}, "inputs and outputs are not those of the header"),
        ({"n_landmarks": 68}, "expected neither landmarks nor corrections of the paper's network"),
        ({"schema_version": 99}, "schema 99 is newer"),
    ],
)
def test_a_header_that_does_not_fit_is_refused(exported: Path, tmp_path: Path, change: dict, message: str) -> None:
    model = onnx.load(str(exported))
    fields = json.loads(model.metadata_props[0].value) | change
    onnx.helper.set_model_props(model, {METADATA_KEY: json.dumps(fields)})
    onnx.save(model, str(tmp_path / "other.onnx"))
    with pytest.raises(InputFileError, match=rf"other\.onnx: .*{message}"):
        load_onnx(tmp_path / "other.onnx")


def test_a_full_disk_is_one_line_and_leaves_nothing(
    checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "network.onnx"
    with files_of_at_most(10_000):
        assert main(["export", "--checkpoint", str(checkpoint), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.endswith(f"{FULL}: '{out}'\n")
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_another_ending_is_refused(checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "--checkpoint", str(checkpoint), "--out", str(tmp_path / "network.pt")]) == 2
    assert "expected a file ending in .onnx" in capsys.readouterr().err
