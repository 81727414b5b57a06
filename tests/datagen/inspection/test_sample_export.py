"""``datagen export``: what other programs read from the files is what the shards contain."""

import json
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from datagen.cli import main
from pix2face.files.images import decode_image, srgb_to_linear
from pix2face.shards.layers import LAYERS
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.pix2face.shard_files import every_layer

CHANNELS = {
    "pncc": ("Pref.X", "Pref.Y", "Pref.Z"),
    "offset": ("offset.X", "offset.Y", "offset.Z"),
    "depth": ("Z",),
    "normals": ("N.X", "N.Y", "N.Z"),
    "uv": ("UV.U", "UV.V"),
}


@pytest.fixture
def shards(tmp_path: Path) -> Path:
    header, samples = every_layer(3)
    write_shard(tmp_path / "shards" / "shard-00000.h5", header, samples[:2])
    write_shard(tmp_path / "shards" / "shard-00001.h5", header, samples[2:])
    return tmp_path / "shards"


def export(shards: Path, *options: str) -> tuple[int, Path]:
    out = shards.parent / "out"
    return main(["export", str(shards), "--out", str(out), *options]), out


def test_openexr_reads_every_layer(shards: Path) -> None:
    status, out = export(shards)
    assert status == 0
    assert sorted(path.name for path in out.iterdir()) == [
        f"00000{number}.{suffix}" for number in range(3) for suffix in ("exr", "json")
    ]
    sample = ShardReader(shards / "shard-00001.h5").read(0)
    file = OpenEXR.File(str(out / "000002.exr"), separate_channels=True)
    channels = {name: channel.pixels for name, channel in file.channels().items()}
    flipped = {"N.Y", "N.Z"}  # y up, z towards the viewer
    names = {"R", "G", "B"}
    for layer, values in sample.layers.items():
        for k, name in enumerate(CHANNELS.get(layer, (layer,))):
            expected = values if values.ndim == 2 else values[..., k]
            found = -channels[name] if name in flipped else channels[name]
            np.testing.assert_array_equal(found, expected)
            assert found.dtype == (np.uint32 if LAYERS[layer].dtype == np.uint8 else np.float32)
            names.add(name)
    assert set(channels) == names
    light = np.dstack([channels[name] for name in "RGB"])
    np.testing.assert_allclose(light, srgb_to_linear(sample.image / 255), atol=1e-3)
    assert light.dtype == np.float16
    assert (file.header()["unit"], file.header()["sample_id"]) == ("mm", "face/2")
    np.testing.assert_array_equal(file.header()["camera"], sample.camera.matrix)


def test_png_files_hold_every_layer_in_their_steps(shards: Path) -> None:
    status, out = export(shards, "--format", "png")
    assert status == 0
    sample = ShardReader(shards / "shard-00000.h5").read(1)
    assert (out / "000001.png").read_bytes() == sample.image_bytes
    np.testing.assert_array_equal(decode_image((out / "000001.png").read_bytes(), "test"), sample.image)
    mask = sample.maps.mask
    steps = {"pncc": 128, "offset": 128, "normals": 32767, "uv": 65534, "depth": 8}
    for layer, values in sample.layers.items():
        name = CHANNELS.get(layer, (layer,))[0].split(".")[0]
        found = cv2.imread(str(out / f"000001-{name}.png"), cv2.IMREAD_UNCHANGED)
        found = found if found.ndim == 2 else found[..., ::-1]
        if layer not in steps:
            assert found.dtype == np.uint8
            scale = 1 if LAYERS[layer].dtype == np.uint8 else 255
            np.testing.assert_array_equal(found, np.rint(values * np.float32(scale)))
            continue
        assert found.dtype == np.uint16
        assert not found[~mask].any()
        zero = {"uv": 1, "depth": 0}.get(layer, 32768)
        decoded = (found[mask].astype(np.float64) - zero) / steps[layer] * ([1, -1, -1] if layer == "normals" else 1)
        decoded = decoded[:, :2] if layer == "uv" else decoded
        assert np.abs(decoded - values[mask]).max() <= 0.5 / steps[layer] + 1e-6


def test_what_pictures_cannot_hold_is_in_json(shards: Path) -> None:
    _, out = export(shards)
    sample = ShardReader(shards / "shard-00000.h5").read(0)
    content = json.loads((out / "000000.json").read_text(encoding="utf-8"))
    assert content["sample_id"] == sample.sample_id
    assert content["attributes"] == sample.attributes
    np.testing.assert_array_equal(content["camera"], sample.camera.matrix)
    np.testing.assert_allclose(content["landmarks2d_px"], sample.landmarks2d, atol=1e-4)
    np.testing.assert_allclose(content["landmarks3d_mm"], sample.landmarks3d, atol=1e-4)


def test_an_interrupted_export_goes_on(shards: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, out = export(shards)
    before = {path.name: path.stat().st_mtime_ns for path in out.iterdir()}
    (out / "000001.json").unlink()  # it is written last
    assert export(shards)[0] == 0
    assert "3 samples (2 there already) -> " in capsys.readouterr().err
    changed = {path.name for path in out.iterdir() if before.get(path.name) != path.stat().st_mtime_ns}
    assert changed == {"000001.exr", "000001.json"}


def test_a_folder_of_another_export_is_refused(shards: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, out = export(shards)
    for damage, options in (("", ("--format", "png")), ("{", ())):
        (out / "000000.json").write_text(damage or (out / "000000.json").read_text())
        capsys.readouterr()
        assert export(shards, *options)[0] == 2
        error = capsys.readouterr().err
        assert "000000.json: expected the same sample and --format as before, found a file of another" in error


def test_values_beyond_16_bits_are_named(shards: Path, capsys: pytest.CaptureFixture[str]) -> None:
    header, (sample, *_) = every_layer(1)
    sample.layers["depth"][10, 10] = 9000
    write_shard(shards / "shard-00000.h5", header, [sample])
    assert export(shards, "--format", "png")[0] == 2
    assert "face/0: expected depth that 16-bit PNG holds, found values up to 9000 mm; use --format exr" in (
        capsys.readouterr().err
    )
