"""Draws the picture of the README: a photograph, the maps that the packaged network predicts, and the fitted mesh.

python -m scripts.draw_astronaut [--out FILE]
"""

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from skimage.data import astronaut

from pix2face import Pix2Face
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.geometry.crops import crop_image
from pix2face.models.rasterise import interpolate, rasterise
from pix2face.photographs.fit_pictures import maps_over
from pix2face.photographs.texture import facing, vertex_colours

HEADINGS = ("Photograph", "Point of the mean face (PNCC)", "Offset from that point", "Fitted mesh, turned by 35°")
TILE_PX, GAP_PX, HEADING_PX, LETTERS_PX = 388, 16, 40, 21
MESH_YAW_DEG = 35.0
MM_PER_TILE = 265.0
SUPERSAMPLING = 3  # of the mesh, for smooth edges


def main() -> int:
    """Draws the tiles and their headings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/images/astronaut.jpg"))
    options = parser.parse_args()
    image = np.ascontiguousarray(astronaut())  # type: ignore[no-untyped-call]
    pix2face = Pix2Face.load(device="cpu")
    (prediction,) = pix2face.predict(image)
    fit = pix2face.fit_prediction(prediction, (image.shape[0], image.shape[1]))
    photograph = crop_image(image, prediction.crop.with_size(TILE_PX))
    options.out.parent.mkdir(parents=True, exist_ok=True)
    sheet([photograph, *maps_over(photograph, prediction.maps), turned_mesh(image, fit)]).save(options.out, quality=90)
    return 0


def turned_mesh(image: np.ndarray, fit: FaceFit) -> np.ndarray:
    """Draws the fitted head from the side, in the colours of its photograph."""
    model, size_px = fit.model, SUPERSAMPLING * TILE_PX
    scale = size_px / MM_PER_TILE
    rotation = rotation_of_pose(HeadPose(0, MESH_YAW_DEG, 0))
    middle = (fit.vertices.min(axis=0) + fit.vertices.max(axis=0)) / 2
    camera = weak_perspective_camera(WeakPerspective(scale, rotation, size_px / 2 - scale * (rotation @ middle)[:2]))
    seen = rasterise(camera.matrix, fit.vertices, model.triangles, size_px, size_px)
    light = 0.65 + 0.35 * np.clip(facing(fit.vertices, model.triangles, camera), 0, 1)
    lit = vertex_colours(image, fit, model) * light[:, None]
    colours = interpolate(seen, lit, model.triangles)
    picture = np.where((seen.triangle >= 0)[..., None], colours, 255).astype(np.uint8)
    return np.asarray(cv2.resize(picture, (TILE_PX, TILE_PX), interpolation=cv2.INTER_AREA))


def sheet(tiles: list[np.ndarray]) -> Image.Image:
    """Draws tiles side by side, each below its heading."""
    drawn = Image.new("RGB", (len(tiles) * (TILE_PX + GAP_PX) - GAP_PX, TILE_PX + HEADING_PX), "white")
    pen, font = ImageDraw.Draw(drawn), ImageFont.load_default(LETTERS_PX)
    for index, (heading, tile) in enumerate(zip(HEADINGS, tiles, strict=True)):
        left = index * (TILE_PX + GAP_PX)
        pen.text((left + TILE_PX / 2, HEADING_PX / 2), heading, "#222222", font, anchor="mm")
        drawn.paste(Image.fromarray(tile), (left, HEADING_PX))
    return drawn


if __name__ == "__main__":
    sys.exit(main())
