"""Packs the environments of the npm package @pmndrs/assets into datagen/assets/environments.h5.

    python -m scripts.build_environment_assets [--package FOLDER_OR_TGZ]

Each environment is stored twice. ``light`` has 64 x 128 averages of the panorama in float16, for lighting. ``picture``
and ``gain`` are the panorama itself (256 x 512), for backdrops: an sRGB JPEG of the colours, divided by a gain where
they are brighter than white, and a grey JPEG of the gain, 2^(16 value / 255).
"""

import argparse
import base64
import re
import tempfile
from pathlib import Path

import cv2
import h5py
import numpy as np
import OpenEXR
from jaxtyping import Float32
from numpy import ndarray

from scripts.npm_package import PMNDRS_ASSETS, unpacked

NAMES = (
    "apartment",
    "bridge",
    "city",
    "dawn",
    "esplanade",
    "forest",
    "hall",
    "lab",
    "lobby",
    "night",
    "park",
    "sky",
    "studio",
    "sunrise",
    "sunset",
    "venice",
    "warehouse",
    "workshop",
)
TARGET = Path(__file__).parents[1] / "datagen" / "assets" / "environments.h5"
LIGHT_SIZE = 64, 128
GAIN_STOPS = 16.0
JPEG_QUALITY = 95
LICENCE = "CC0-1.0"


def main() -> None:
    """Writes the file and prints its size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--package", type=Path, help="archive or unpacked folder; without it npm downloads the package")
    parser.add_argument("--output", type=Path, default=TARGET)
    options = parser.parse_args()
    options.output.parent.mkdir(parents=True, exist_ok=True)
    with unpacked(PMNDRS_ASSETS, options.package) as folder:
        panoramas = {name: read_panorama(folder / "hdri" / f"{name}.exr.js") for name in NAMES}
    with h5py.File(options.output, "w", libver="v110") as file:
        file.attrs["origin"] = f"npm package {PMNDRS_ASSETS.requirement}, folder hdri"
        file.attrs["licence"] = LICENCE
        file.attrs["gain_stops"] = GAIN_STOPS
        for name, panorama in panoramas.items():
            _write(file.create_group(name, track_order=False), panorama)
    print(f"{options.output}: {len(panoramas)} environments, {options.output.stat().st_size / 1e6:.2f} MB")


def read_panorama(path: Path) -> Float32[ndarray, "h w 3"]:
    """Reads an EXR file inside a JavaScript file: linear light, rows from the zenith down.

    Compression causes ringing beside the sun, with negative values. They are kept, so that averages are correct.
    """
    found = re.search(r"base64,([A-Za-z0-9+/=]+)", path.read_text(encoding="ascii"))
    if found is None:
        raise SystemExit(f"{path}: expected an EXR as base64, found none; is the package another version?")
    with tempfile.TemporaryDirectory() as place:
        exr = Path(place) / "panorama.exr"
        exr.write_bytes(base64.b64decode(found.group(1)))
        with OpenEXR.File(str(exr)) as file:
            return np.array(file.channels()["RGB"].pixels, dtype=np.float32)


def split_gain(panorama: Float32[ndarray, "h w 3"]) -> tuple[ndarray, ndarray]:
    """Returns the colours divided by a gain as sRGB bytes, and the logarithm of the gain as bytes."""
    stops = np.log2(np.maximum(panorama.max(axis=2), 1.0))
    gain = np.clip(np.ceil(stops / GAIN_STOPS * 255), 0, 255).astype(np.uint8)
    below = panorama / np.exp2(gain[..., None].astype(np.float32) / 255 * GAIN_STOPS)
    srgb = np.where(below <= 0.0031308, 12.92 * below, 1.055 * np.maximum(below, 1e-6) ** (1 / 2.4) - 0.055)
    return np.clip(srgb * 255 + 0.5, 0, 255).astype(np.uint8), gain


def _write(group: h5py.Group, panorama: Float32[ndarray, "h w 3"]) -> None:
    rows, columns = LIGHT_SIZE
    light = np.maximum(cv2.resize(panorama, (columns, rows), interpolation=cv2.INTER_AREA), 0).astype(np.float16)
    group.create_dataset("light", data=light, compression="gzip", compression_opts=9, shuffle=True, track_times=False)
    picture, gain = split_gain(np.maximum(panorama, 0))
    for name, pixels in (("picture", picture[..., ::-1]), ("gain", gain)):
        written, encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        assert written
        group.create_dataset(name, data=encoded.reshape(-1), track_times=False)


if __name__ == "__main__":
    main()
