"""Draws the README's picture: a photograph, the maps that the packaged network predicts, and the fitted mesh, turned.

The network answers at 128 pixels, which would show as blocks: maps are drawn smoothly, and small holes of their mask
are drawn closed. The maps themselves stay as they are.

python -m scripts.draw_astronaut [--out FILE]
"""

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import binary_fill_holes
from skimage.data import astronaut

from pix2face import Pix2Face
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.geometry.crops import crop_image, square_crop
from pix2face.geometry.maps import map_picture
from pix2face.models.rasterise import interpolate, rasterise
from pix2face.photographs.fit_pictures import PICTURE_LIMITS_MM
from pix2face.photographs.texture import facing, vertex_colours

HEADINGS = ("Photograph", "Point of the mean face (PNCC)", "Offset from that point", "Fitted mesh, turned by 35°")
TILE_PX, GAP_PX, HEADING_PX, LETTERS_PX = 388, 16, 40, 21
MESH_YAW_DEG = 35.0
MM_A_TILE = 265.0  # how much of the turned head is shown
BLUR_PX = 3.0  # of the network's pixels: its offsets come in blocks of four
SMOOTHER = 3  # the mesh is drawn at this many times the size, for its edges


def main() -> int:
    """Draws the tiles and their headings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/images/astronaut.jpg"))
    options = parser.parse_args()
    image = np.ascontiguousarray(astronaut())  # type: ignore[no-untyped-call]
    pix2face = Pix2Face.load(device="cpu")
    (prediction,) = pix2face.predict(image)
    fit = pix2face.fit_prediction(prediction, (image.shape[0], image.shape[1]))
    photograph = crop_image(image, square_crop(prediction.box, pix2face.predictor.header.crop_scale, TILE_PX))
    maps = prediction.maps
    drawn = [
        smooth_map(values, maps.mask, limit, photograph)
        for values, limit in zip((maps.pncc, maps.offset), PICTURE_LIMITS_MM, strict=True)
    ]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    sheet([photograph, *drawn, turned_mesh(image, fit)]).save(options.out, quality=90)
    return 0


def smooth_map(values_mm: np.ndarray, mask: np.ndarray, limit_mm: float, photograph: np.ndarray) -> np.ndarray:
    """A map over the faded photograph, of the same size, without blocks and without small holes."""
    face = binary_fill_holes(mask)
    weight = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), BLUR_PX)[..., None]
    blurred = cv2.GaussianBlur(values_mm * mask[..., None], (0, 0), BLUR_PX) / np.maximum(weight, 1e-6)
    size = photograph.shape[:2]
    whole = cv2.resize(blurred, size, interpolation=cv2.INTER_CUBIC)
    share = cv2.resize(cv2.GaussianBlur(face.astype(np.float32), (0, 0), 1), size, interpolation=cv2.INTER_CUBIC)
    edge = np.clip((share - 0.5) * 8 + 0.5, 0, 1)[..., None]
    picture = map_picture(whole.astype(np.float32), np.ones(size, dtype=bool), limit_mm)
    faded = 255 - 0.25 * (255 - photograph.mean(axis=2, keepdims=True))
    return np.asarray(edge * picture + (1 - edge) * faded, dtype=np.uint8)


def turned_mesh(image: np.ndarray, fit: FaceFit) -> np.ndarray:
    """The fitted head in the colours of its photograph, seen from the side."""
    model, size_px = fit.model, SMOOTHER * TILE_PX
    scale = size_px / MM_A_TILE
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
    """Tiles side by side, each below its heading."""
    drawn = Image.new("RGB", (len(tiles) * (TILE_PX + GAP_PX) - GAP_PX, TILE_PX + HEADING_PX), "white")
    pen, font = ImageDraw.Draw(drawn), ImageFont.load_default(LETTERS_PX)
    for index, (heading, tile) in enumerate(zip(HEADINGS, tiles, strict=True)):
        left = index * (TILE_PX + GAP_PX)
        pen.text((left + TILE_PX / 2, HEADING_PX / 2), heading, "#222222", font, anchor="mm")
        drawn.paste(Image.fromarray(tile), (left, HEADING_PX))
    return drawn


if __name__ == "__main__":
    sys.exit(main())
