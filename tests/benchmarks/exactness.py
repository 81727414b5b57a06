"""How exact maps are: python -m tests.benchmarks.exactness --out exactness.json.

Rendered ones by each rasteriser against the float64 oracle (which the tests hold to ray casting), and jittered ones, as
training sees them, against maps rendered at the crop. Faces of the built-in model with expressions, any yaw, near
pinholes and affine cameras. The tests hold the same figures to their limits.
"""

from functools import cache

import cv2
import numpy as np
from numpy import ndarray

from datagen.opengl.gl_context import GLContext, create_gl_context
from datagen.rendering.renderer import Renderer
from datagen.sampling.faces import sample_faces
from pix2face.geometry.camera import Camera, linearised
from pix2face.geometry.crops import FaceBox, crop_camera
from pix2face.geometry.jitter import JitterRange, crop_maps, draw_jitter, jitter_crop
from pix2face.geometry.landmarks import IBUG68
from pix2face.geometry.maps import FaceMaps, fixed_point_to_maps
from pix2face.models.morphable_model import MorphableModel, builtin_model
from pix2face.models.rasterise import render_maps
from pix2face.shards.layers import LAYERS, to_stored
from tests.benchmarks.measuring import options_parser, write_report

# Side of the picture, and faces in it.
RENDERED = ((64, 12), (200, 6), (256, 6), (450, 3))
LIMIT_MM = 0.002


def errors_mm(found: dict[str, ndarray], expected: dict[str, ndarray]) -> ndarray:
    """Largest difference in PNCC, offset and depth of each pixel that both call face."""
    both = found["mask"] & expected["mask"]
    differences = [np.abs(found[name] - expected[name])[both] for name in ("pncc", "offset")]
    return np.maximum(np.max(differences, axis=(0, 2)), np.abs(found["depth"] - expected["depth"])[both])


def faces(model: MorphableModel, n: int, size_px: int) -> list[tuple[ndarray, Camera]]:
    """Faces with expressions, of any yaw, through near pinholes and affine cameras in turn."""
    table = sample_faces(model, n, 11, size_px)
    vertices = model.vertices(table.identity, table.expression)
    cameras = [Camera(matrix) for matrix in table.cameras]
    return [(vertices[i], linearised(camera) if i % 2 else camera) for i, camera in enumerate(cameras)]


@cache
def rendered_by_the_oracle(size_px: int, n: int) -> list[tuple[ndarray, Camera, dict[str, ndarray]]]:
    """Faces with their true maps, which are made once for all rasterisers."""
    model = builtin_model()
    return [(v, c, render_maps(model, v, c, size_px, size_px)) for v, c in faces(model, n, size_px)]


def rendering_errors(gl: GLContext | None, rasteriser: str, size_px: int, n: int) -> tuple[ndarray, int]:
    """Errors of all face pixels of some faces, mm, and in how many pixels the masks differ."""
    renderer = Renderer(builtin_model(), size_px, size_px, gl, rasteriser)
    errors, mask_differs = [], 0
    for vertices, camera, expected in rendered_by_the_oracle(size_px, n):
        found = renderer.render(vertices, camera)
        errors.append(errors_mm(found, expected))
        mask_differs += int((found["mask"] != expected["mask"]).sum())
    return np.concatenate(errors), mask_differs


def jitter_errors(n: int, picture_px: int, crop_px: int) -> tuple[ndarray, float]:
    """Errors (mm) of stored maps resampled into jittered crops, more than 3 px from silhouettes and folds.

    Returns:
        Those of PNCC and offset, and the least share of such pixels of a face that the resampled mask covers.
    """
    model, rng = builtin_model(), np.random.default_rng(0)
    table = sample_faces(model, n, 77, picture_px)
    errors, covered = [], 1.0
    for index in range(n):
        vertices = model.vertices(table.identity[index][None], table.expression[index][None])[0]
        camera = Camera(table.cameras[index])
        box = FaceBox.around(camera.project(vertices[model.landmarks[IBUG68]]))
        crop = jitter_crop(box, draw_jitter(rng, JitterRange()), crop_px)
        source = render_maps(model, vertices, camera, picture_px, picture_px)
        pncc, offset = (
            fixed_point_to_maps(to_stored(LAYERS["pncc"], own)) for own in (source["pncc"], source["offset"])
        )
        cropped = crop_maps(FaceMaps(pncc, offset, source["mask"]), crop)
        truth = render_maps(model, vertices, crop_camera(camera, crop), crop_px, crop_px)
        inner = _away_from_folds(truth)
        covered = min(covered, float(cropped.mask[inner].mean()))
        inner &= cropped.mask
        for ours, true in ((cropped.pncc, truth["pncc"]), (cropped.offset, truth["offset"])):
            errors.append(np.linalg.norm(ours - true, axis=2)[inner])
    return np.concatenate(errors), covered


def _away_from_folds(rendered: dict[str, ndarray]) -> ndarray:
    """Face pixels more than 3 px from where the surface ends or jumps by 1 cm in depth."""
    kernel = np.ones((3, 3), np.uint8)
    depth = np.where(np.isfinite(rendered["surface_depth"]), rendered["surface_depth"], 1e5)
    fold = cv2.dilate(depth, kernel) - cv2.erode(depth, kernel) > 10
    mask = rendered["mask"].astype(np.uint8)
    fold |= cv2.dilate(mask, kernel) != cv2.erode(mask, kernel)
    return (cv2.distanceTransform((~fold).astype(np.uint8), cv2.DIST_L2, 5) > 3) & rendered["mask"]


def _rendered(gl: GLContext | None, rasteriser: str) -> dict[str, object]:
    measured = [rendering_errors(gl, rasteriser, size_px, n) for size_px, n in RENDERED]
    error = np.concatenate([own for own, _ in measured])
    return {
        "pixels": len(error),
        "limit_mm": LIMIT_MM,
        "beyond_limit": int((error > LIMIT_MM).sum()),
        "99.99_percent_within_mm": float(np.quantile(error, 0.9999)),
        "masks_differ_in": sum(differs for _, differs in measured),
    }


def _jittered(n: int, picture_px: int, crop_px: int) -> dict[str, float]:
    error, covered = jitter_errors(n, picture_px, crop_px)
    return {
        "median_mm": float(np.median(error)),
        "95_percent_within_mm": float(np.quantile(error, 0.95)),
        "least_share_covered": covered,
    }


def main() -> None:
    parser = options_parser(__doc__)
    parser.add_argument("--faces", type=int, default=24, help="jittered faces")
    options = parser.parse_args()
    with create_gl_context() as gl:
        names = ["processor", "compute"] if gl.version_code >= 430 else ["processor"]
        result = {
            "rendered": {name: _rendered(gl, name) for name in names},
            "jittered": {
                f"{picture} px to {crop} px": _jittered(options.faces, picture, crop)
                for picture, crop in ((450, 256), (256, 256), (256, 128))
            },
        }
    write_report(result, options.out)


if __name__ == "__main__":
    main()
