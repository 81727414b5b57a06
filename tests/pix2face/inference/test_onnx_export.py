"""The ONNX file computes what torch computes, for any batch, and carries all that a user needs."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from pix2face.commands.cli import main
from pix2face.errors import InputFileError, UsageError
from pix2face.geometry.crops import FaceBox
from pix2face.inference.checkpoint import METADATA_KEY, load_checkpoint, save_checkpoint
from pix2face.inference.onnx_export import INPUT_NAME, OUTPUT_NAME, export_onnx, load_onnx
from pix2face.inference.predictor import Predictor
from pix2face.networks.residual import ResidualUNet, residual_widths
from tests.full_disk import FULL, files_of_at_most
from tests.pix2face.photographs.seen_faces import header_of, write_checkpoint
from tests.synthetic_models import small_head_model

onnx = pytest.importorskip("onnx", reason="pip install 'pix2face[onnx]'")
onnxruntime = pytest.importorskip("onnxruntime", reason="pip install 'pix2face[onnx]'")
pytest.importorskip("onnxscript", reason="pip install 'pix2face[onnx]'")


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


def test_the_residual_network_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From a file in float16, as releases are."""
    torch.manual_seed(0)
    widths = residual_widths(2)
    own = replace(header_of(small_head_model(), 64), architecture="residual", widths=widths, planes=9, n_landmarks=68)
    network = ResidualUNet(widths, 9, 68)
    network(torch.rand(4, 3, 64, 64) - 0.5)  # norms with statistics of their own
    for block in network.inner:
        block.first_norm.running_var /= 1e4  # so that their bounds are reached
    save_checkpoint(tmp_path / "c.safetensors", own, network, torch.float16)
    export_onnx(tmp_path / "c.safetensors", tmp_path / "network.onnx")
    header, run = load_onnx(tmp_path / "network.onnx")
    assert header == own
    images = torch.rand(3, 3, 64, 64) - 0.5
    with torch.inference_mode():
        expected = load_checkpoint(tmp_path / "c.safetensors")[1](images)
        monkeypatch.setattr("pix2face.networks.blocks.FARTHEST", 1e6)
        unbounded = load_checkpoint(tmp_path / "c.safetensors")[1](images)
    assert (unbounded[0] - expected[0]).abs().max() > 0.01 * (expected[0].max() - expected[0].min())
    for found, wanted in zip(run(images), expected, strict=True):
        assert (found - wanted).abs().max() <= 1e-4 * (wanted.max() - wanted.min())


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
    by_torch, by_onnx = (Predictor.load(path, "cpu").predict(image, box) for path in (checkpoint, exported))
    np.testing.assert_allclose(by_onnx.maps.pncc, by_torch.maps.pncc, atol=150 * 1e-4)
    np.testing.assert_array_equal(by_onnx.crop.image_from_crop, by_torch.crop.image_from_crop)


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
    with pytest.raises(InputFileError, match=r"foreign\.onnx: expected a network that `pix2face export` wrote"):
        load_onnx(tmp_path / "foreign.onnx")


def test_a_newer_schema_is_refused(exported: Path, tmp_path: Path) -> None:
    model = onnx.load(str(exported))
    fields = json.loads(model.metadata_props[0].value) | {"schema_version": 99}
    onnx.helper.set_model_props(model, {METADATA_KEY: json.dumps(fields)})
    onnx.save(model, str(tmp_path / "newer.onnx"))
    with pytest.raises(InputFileError, match="schema 99 is newer"):
        load_onnx(tmp_path / "newer.onnx")


def test_without_the_packages_the_line_that_installs_them(
    checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "onnx", None)
    with pytest.raises(UsageError, match=r"pip install 'pix2face\[onnx\]'"):
        export_onnx(checkpoint, tmp_path / "network.onnx")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_one_line_and_leaves_nothing(
    checkpoint: Path,
    exported: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "network.onnx"
    program = SimpleNamespace(model_proto=onnx.load(str(exported)))  # seconds to make anew
    monkeypatch.setattr("torch.onnx.export", lambda *args, **options: program)
    with files_of_at_most(10_000):
        assert main(["export", "--checkpoint", str(checkpoint), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.endswith(f"{FULL}: '{out}'\n")
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_another_ending_is_refused(checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "--checkpoint", str(checkpoint), "--out", str(tmp_path / "network.pt")]) == 2
    assert "expected a file ending in .onnx" in capsys.readouterr().err
