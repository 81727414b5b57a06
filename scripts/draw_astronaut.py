"""Draws ``docs/images/astronaut.jpg``: a photograph through the packaged network: crop, PNCC, offset, fit.

python -m scripts.draw_astronaut [--out FILE]
"""

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
from skimage.data import astronaut

from pix2face import Pix2Face
from pix2face.geometry.crops import crop_image, square_crop
from pix2face.photographs.fit_pictures import draw_maps, draw_overlay

TILE_PX = 256


def main() -> int:
    """Draws the strip."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/images/astronaut.jpg"))
    options = parser.parse_args()
    image = np.ascontiguousarray(astronaut())  # type: ignore[no-untyped-call]
    pix2face = Pix2Face.load(device="cpu")
    (box,) = pix2face.find_faces(image)
    (prediction,) = pix2face.predict(image, [box])
    fit = pix2face.fit_prediction(prediction, (image.shape[0], image.shape[1]))
    strip = draw_maps(crop_image(image, prediction.crop), prediction.maps)
    maps = cv2.resize(strip, (3 * TILE_PX, TILE_PX), interpolation=cv2.INTER_NEAREST)[:, TILE_PX:]
    crop = crop_image(image, square_crop(box, pix2face.inference.predictor.header.crop_scale, TILE_PX))
    drawn = np.hstack([crop, maps, draw_overlay(image, fit, pix2face.model, TILE_PX)])
    options.out.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(options.out), drawn[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])
    return 0


if __name__ == "__main__":
    sys.exit(main())
