import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from pix2face.errors import InputFileError, ModelMismatchError
from pix2face.inference.checkpoint import METADATA_KEY, SCHEMA_VERSION, CheckpointHeader
from pix2face.inference.onnx_files import open_network
from pix2face.inference.torch_networks import load_checkpoint, save_checkpoint
from pix2face.networks.dimensions import paper_widths, residual_widths
from pix2face.networks.paper import UNet
from pix2face.networks.residual import ResidualUNet

HEADER = CheckpointHeader(
    model_name="small head",
    model_sha256="a" * 64,
    size_px=16,
    widths=paper_widths(16, 4),
    pncc_scale_mm=133.25,
    offset_scale_mm=30.0,
    smallest_radius_mm=61.5,
    licence="CC0-1.0",
    configuration='{"seed": 0}',
    epoch=3,
)


both_ways = pytest.mark.parametrize("load", [load_checkpoint, open_network])


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    save_checkpoint(tmp_path / "new" / "checkpoint.safetensors", HEADER, UNet(16, 4))
    return tmp_path / "new" / "checkpoint.safetensors"


def test_header_and_weights_come_back(tmp_path):
    torch.manual_seed(1)
    network, picture = UNet(16, 4), torch.rand(1, 3, 16, 16) - 0.5
    save_checkpoint(tmp_path / "c.safetensors", HEADER, network)
    header, loaded = load_checkpoint(tmp_path / "c.safetensors")
    assert header == HEADER
    assert not loaded.training
    torch.testing.assert_close(loaded(picture), network(picture), rtol=0, atol=0)


def test_whoever_may_read_new_files_may_read_a_checkpoint(checkpoint):
    (checkpoint.parent / "ordinary").touch()
    assert checkpoint.stat().st_mode == (checkpoint.parent / "ordinary").stat().st_mode


def test_nothing_but_the_checkpoint_is_left_in_its_folder(checkpoint):
    assert list(checkpoint.parent.iterdir()) == [checkpoint]


def test_any_safetensors_library_reads_it(checkpoint):
    tensors = load_file(checkpoint)
    assert tensors["encoder.0.weight"].shape == (4, 3, 4, 4)


def test_a_failed_write_keeps_the_old_file(checkpoint, monkeypatch):
    def fail(*arguments: object, **options: object) -> None:
        raise OSError("disk full")

    before = checkpoint.read_bytes()
    monkeypatch.setattr("pix2face.inference.torch_networks.save_file", fail)
    with pytest.raises(OSError, match="disk full"):
        save_checkpoint(checkpoint, HEADER, UNet(16, 4))
    assert checkpoint.read_bytes() == before
    assert list(checkpoint.parent.iterdir()) == [checkpoint]


@both_ways
@pytest.mark.parametrize("kept", [0, 5, 100, 0.5, 0.999])
def test_a_truncated_file_is_refused(checkpoint, kept, load):
    content = checkpoint.read_bytes()
    checkpoint.write_bytes(content[: int(kept * len(content)) if isinstance(kept, float) else kept])
    with pytest.raises(InputFileError, match=r"checkpoint\.safetensors: expected a complete safetensors file"):
        load(checkpoint)


@both_ways
def test_a_missing_file_is_refused(tmp_path, load):
    with pytest.raises(InputFileError, match=r"expected a checkpoint, found a folder; training writes .*/checkpoint\."):
        load(tmp_path)
    with pytest.raises(InputFileError, match=r"none\.safetensors: no such file; `train"):
        load(tmp_path / "none.safetensors")


@both_ways
def test_a_foreign_file_is_refused(tmp_path, load):
    (tmp_path / "pickle.pt").write_bytes(b"\x80\x02}q\x00." * 40)
    with pytest.raises(InputFileError, match="expected a complete safetensors file"):
        load(tmp_path / "pickle.pt")
    save_file({"weight": torch.zeros(1)}, tmp_path / "other.safetensors", metadata={"format": "pt"})
    with pytest.raises(InputFileError, match="expected pix2face-checkpoint in the metadata, found format"):
        load(tmp_path / "other.safetensors")


def test_a_checkpoint_of_the_second_schema_has_no_landmarks():
    fields = asdict(HEADER) | {"schema_version": 2}
    del fields["n_landmarks"]
    assert CheckpointHeader.from_json(fields) == HEADER


def test_a_checkpoint_of_the_first_schema_is_read(checkpoint):
    fields = asdict(HEADER) | {"schema_version": 1, "filters": 4}
    for name in ("widths", "samples", "architecture", "planes"):
        del fields[name]
    save_file(load_file(checkpoint), checkpoint, metadata={METADATA_KEY: json.dumps(fields)})
    header, network = load_checkpoint(checkpoint)
    assert header == HEADER
    assert network(torch.zeros(1, 3, 16, 16)).shape == (1, 6, 16, 16)


@pytest.mark.parametrize("planes", [6, 7, 8])
def test_the_residual_network_comes_back(tmp_path, planes):
    torch.manual_seed(0)
    widths = residual_widths(2)
    header = replace(HEADER, architecture="residual", size_px=64, widths=widths, planes=planes, samples=77)
    network = ResidualUNet(widths, planes)
    network(torch.rand(2, 3, 64, 64))  # moves the statistics of its norms
    save_checkpoint(tmp_path / "c.safetensors", header, network.eval())
    found, loaded = load_checkpoint(tmp_path / "c.safetensors")
    picture = torch.rand(1, 3, 64, 64) - 0.5
    assert found == header
    torch.testing.assert_close(loaded(picture), network(picture), rtol=0, atol=0)


def test_a_checkpoint_of_half_the_size_computes_in_float32(tmp_path):
    torch.manual_seed(0)
    widths = residual_widths(2)
    header, network = replace(HEADER, architecture="residual", size_px=64, widths=widths), ResidualUNet(widths)
    sizes, planes = [], []
    for precision in (torch.float32, torch.float16):
        path = tmp_path / f"{precision}.safetensors"
        save_checkpoint(path, header, network.eval(), precision)
        loaded = load_checkpoint(path)[1]
        assert all(tensor.dtype in (torch.float32, torch.int64) for tensor in loaded.state_dict().values())
        sizes.append(path.stat().st_size)
        planes.append(loaded(torch.zeros(1, 3, 64, 64) + 0.1))
    assert sizes[1] < 0.6 * sizes[0]
    assert not torch.equal(*planes)
    torch.testing.assert_close(*planes, rtol=1e-2, atol=1e-2 * float(planes[0].detach().abs().max()))


@both_ways
@pytest.mark.parametrize("header", ["[]", "{", "{}", '{"schema_version": "x"}'])
def test_a_header_that_is_none_is_refused(tmp_path, header, load):
    save_file({"weight": torch.zeros(1)}, tmp_path / "c.safetensors", metadata={METADATA_KEY: header})
    with pytest.raises(InputFileError, match="expected pix2face-checkpoint"):
        load(tmp_path / "c.safetensors")


@both_ways
@pytest.mark.parametrize("planes", [-1, 10**9])
def test_planes_of_an_earlier_schema_are_checked_before_memory_is_taken(tmp_path, planes, load):
    fields = asdict(replace(HEADER, architecture="residual", size_px=64, widths=residual_widths(2)))
    header = json.dumps(fields | {"schema_version": 3, "planes": planes})
    save_file({"weight": torch.zeros(1)}, tmp_path / "c.safetensors", metadata={METADATA_KEY: header})
    with pytest.raises(InputFileError, match=r"header and weights do not make a network .expected 6 to 9 planes"):
        load(tmp_path / "c.safetensors")


@both_ways
def test_numbers_that_are_not_real_are_refused(checkpoint, load):
    weights = load_file(checkpoint)
    weights["encoder.0.bias"] = weights["encoder.0.bias"].to(torch.bfloat16)
    save_file(weights, checkpoint, metadata={METADATA_KEY: json.dumps(asdict(HEADER))})
    with pytest.raises(InputFileError, match="expected arrays in float16 or float32, found others"):
        load(checkpoint)


@both_ways
def test_arrays_of_more_dimensions_than_numpy_has_are_refused(checkpoint, load):
    weights = load_file(checkpoint)
    weights["encoder.0.bias"] = weights["encoder.0.bias"].reshape([1] * 100 + [-1])
    save_file(weights, checkpoint, metadata={METADATA_KEY: json.dumps(asdict(HEADER))})
    with pytest.raises(InputFileError, match="expected arrays in float16 or float32, found others"):
        load(checkpoint)


def test_damaged_weights_are_opened_without_a_warning(checkpoint):
    """Warnings are errors in tests. The maps are then not finite, and that is said where they are used."""
    path = checkpoint.parent / "residual.safetensors"
    network = ResidualUNet(residual_widths(2))
    network.stem_norm.running_var.fill_(-1)
    save_checkpoint(path, replace(HEADER, architecture="residual", size_px=64, widths=residual_widths(2)), network)
    answers = open_network(path)[1].answers(np.zeros((1, 64, 64, 3), np.float32))
    assert not np.isfinite(answers.planes).all()


@both_ways
def test_a_newer_schema_is_refused(tmp_path, load):
    path = tmp_path / "c.safetensors"
    save_checkpoint(path, replace(HEADER, schema_version=SCHEMA_VERSION + 1), UNet(16, 4))
    with pytest.raises(InputFileError, match=rf"schema {SCHEMA_VERSION + 1} is newer than {SCHEMA_VERSION}.*upgrade"):
        load(path)


@both_ways
@pytest.mark.parametrize(
    "change",
    [
        {"widths": (8, 16, 32, 64)},
        {"widths": ()},
        {"widths": None},
        {"size_px": 32},
        {"size_px": 17},
        {"nonsense": 1},
        {"planes": 8},
        {"planes": 9},
        {"architecture": "residual"},
        {"architecture": "transformer"},
        {"widths": (4, 1024, 1024)},
        {"size_px": 10**9},
        {"crop_scale": 0},
        {"crop_scale": 10**400},
        {"smallest_radius_mm": "60"},
        {"pncc_scale_mm": 0.0},
        {"configuration": "[]"},
        {"configuration": "no JSON"},
        {"epoch": None},
        {"landmarks": {"ibug68": [0.5]}},
    ],
)
def test_a_header_that_does_not_fit_the_weights_is_refused(checkpoint, change, load):
    header = {name: getattr(HEADER, name) for name in HEADER.__dataclass_fields__} | change
    save_file(load_file(checkpoint), checkpoint, metadata={METADATA_KEY: json.dumps(header)})
    with pytest.raises(InputFileError, match="header and weights do not make a network"):
        load(checkpoint)


def test_another_model_is_refused_and_both_are_named():
    HEADER.check_model("the same under another name", "a" * 64)
    with pytest.raises(ModelMismatchError, match=r"'small head' \(aaaaaaaaaaaa\).*'big head' \(bbbbbbbbbbbb\)"):
        HEADER.check_model("big head", "b" * 64)


def test_statistics_of_norms_do_not_overflow_in_a_checkpoint_of_half_the_size(tmp_path):
    widths = residual_widths(2)
    header, network = replace(HEADER, architecture="residual", size_px=64, widths=widths), ResidualUNet(widths)
    network.stem_norm.running_var.fill_(1e5)  # float16 ends at 65,504
    save_checkpoint(tmp_path / "half.safetensors", header, network.eval(), torch.float16)
    assert (load_checkpoint(tmp_path / "half.safetensors")[1].stem_norm.running_var == 1e5).all()


def test_residual_networks_of_the_third_schema_have_no_coarse_planes(tmp_path):
    widths, path = residual_widths(2), tmp_path / "c.safetensors"
    fields = asdict(replace(HEADER, architecture="residual", size_px=64, widths=widths)) | {"schema_version": 3}
    network = ResidualUNet(widths).eval()
    weights = {
        name: own.contiguous() for name, own in network.state_dict().items() if not name.startswith("coarse_planes")
    }
    save_file(weights, path, metadata={METADATA_KEY: json.dumps(fields)})
    picture = torch.rand(1, 3, 64, 64) - 0.5
    torch.testing.assert_close(load_checkpoint(path)[1](picture), network(picture), rtol=0, atol=0)
    answers = open_network(path)[1].answers(picture.permute(0, 2, 3, 1).numpy())
    expected = network(picture).detach().permute(0, 2, 3, 1).numpy()
    np.testing.assert_allclose(answers.planes, expected, atol=1e-4 * np.ptp(expected))
    save_file(weights, path, metadata={METADATA_KEY: json.dumps(fields | {"schema_version": SCHEMA_VERSION})})
    for load in (load_checkpoint, open_network):
        with pytest.raises(InputFileError, match=r"coarse_planes.0.(bias|weight) should be \(6,.*\) and is missing"):
            load(path)


def test_a_network_that_corrects_its_fits_comes_back(tmp_path):
    torch.manual_seed(0)
    widths = residual_widths(2)
    header = replace(HEADER, architecture="residual", size_px=64, widths=widths, n_corrected=5)
    network = ResidualUNet(widths, corrected=5)
    save_checkpoint(tmp_path / "c.safetensors", header, network.eval())
    found, loaded = load_checkpoint(tmp_path / "c.safetensors")
    assert found == header
    for own, other in zip(loaded.state_dict().values(), network.state_dict().values(), strict=True):
        torch.testing.assert_close(own, other, rtol=0, atol=0)
    fields = {name: value for name, value in asdict(header).items() if name != "n_corrected"}
    assert CheckpointHeader.from_json(fields | {"schema_version": 4}) == replace(header, n_corrected=0)
