"""The command ``pix2face``: photographs in, maps, camera, mesh and landmarks out."""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, final

import cv2
import numpy as np
import tyro
from jaxtyping import UInt8
from numpy import ndarray
from rich.console import Console

from pix2face.camera import head_pose, linearised, nearest_weak_perspective
from pix2face.command_line import EXIT_REJECTED, prepare_output_folder, progress_bar, run_commands, say
from pix2face.crops import FaceBox, crop_image
from pix2face.detection import detect_faces
from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from pix2face.fit_pictures import draw_maps, draw_overlay, write_mesh, write_point_cloud
from pix2face.fitting.coefficient_fit import PREDICTED_MAPS_REGULARISATION
from pix2face.fitting.face_fit import CameraKind, FaceFit, fit_face
from pix2face.images import read_photograph
from pix2face.morphable_model import BUILTIN_MODEL, MorphableModel, open_model
from pix2face.predictor import Prediction, Predictor
from pix2face.runs import latest_checkpoint

console = Console(stderr=True)

LARGEST_BOX_PX = 1e6

Photograph = UInt8[ndarray, "h w 3"]


@final
@dataclass(frozen=True)
class PredictConfig:
    """Configuration of ``pix2face predict``."""

    images: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Photographs."""
    out: Path = Path("out/predict")
    """Folder for the maps."""
    checkpoint: Path | None = None
    """What training wrote; default is the last one below runs/."""
    box: tuple[float, float, float, float] | None = None
    """Face box in pixels: left top right bottom (tight around the 68 landmarks). Without it faces are detected."""
    largest: bool = False
    """Take only the largest face of each photograph."""


@final
@dataclass(frozen=True)
class FitConfig:
    """Configuration of ``pix2face fit``."""

    images: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Photographs."""
    out: Path = Path("out/fit")
    """Folder for fits, meshes, point clouds and overlays."""
    checkpoint: Path | None = None
    """What training wrote; default is the last one below runs/."""
    box: tuple[float, float, float, float] | None = None
    """Face box in pixels: left top right bottom (tight around the 68 landmarks). Without it faces are detected."""
    largest: bool = False
    """Take only the largest face of each photograph."""
    model: str = BUILTIN_MODEL
    """``builtin`` or a model file: the one that the checkpoint was trained for."""
    camera: CameraKind = "weak-perspective"
    """Camera of the fit; the principal point of a pinhole is the centre of the photograph."""
    regularisation: float = PREDICTED_MAPS_REGULARISATION
    """Tikhonov weight of the coefficients, in mm^2."""


@final
@dataclass(frozen=True, eq=False)
class SeenFace:
    """One face of one photograph, and the name that its files get."""

    name: str
    image: Photograph
    prediction: Prediction


def predict(config: Annotated[PredictConfig, tyro.conf.arg(name="")]) -> int:
    """Predict the maps of every face: NAME.npz (pncc, offset in mm, mask, image_from_crop) and NAME-maps.png."""
    _check_call(config)
    predictor = Predictor.load(config.checkpoint or latest_checkpoint())

    def write(face: SeenFace) -> None:
        prediction = face.prediction
        np.savez_compressed(
            config.out / f"{face.name}.npz",
            pncc=prediction.maps.pncc,
            offset=prediction.maps.offset,
            mask=prediction.maps.mask,
            image_from_crop=prediction.crop.image_from_crop,
        )
        _write_maps(config.out, face)

    return _for_each_face(config, predictor, write)


def fit(config: Annotated[FitConfig, tyro.conf.arg(name="")]) -> int:
    """Fit camera, coefficients and landmarks to every face: NAME.json, .obj, .ply, -maps.png, -overlay.jpg."""
    _check_call(config)
    model = open_model(config.model)
    predictor = Predictor.load(config.checkpoint or latest_checkpoint())
    predictor.header.check_model(model.name, model.sha256)

    def write(face: SeenFace) -> None:
        maps, crop = face.prediction.maps, face.prediction.crop
        height, width = face.image.shape[:2]
        fitted = fit_face(
            maps,
            model,
            camera_kind=config.camera,
            regularisation=config.regularisation,
            principal_point_px=crop.to_crop(np.array([width, height]) / 2),
        ).in_image(crop)
        overlay = draw_overlay(face.image, fitted, model)  # may fail: before anything is written
        (config.out / f"{face.name}.json").write_text(fit_to_json(fitted, model))
        write_mesh(config.out / f"{face.name}.obj", fitted, model)
        write_point_cloud(config.out / f"{face.name}.ply", maps, crop_image(face.image, crop))
        _write_maps(config.out, face)
        _write_picture(config.out / f"{face.name}-overlay.jpg", overlay)

    return _for_each_face(config, predictor, write)


def fit_to_json(fitted: FaceFit, model: MorphableModel) -> str:
    """A fit as JSON: camera, pose, coefficients and landmarks in pixels of the photograph (centres at +0.5)."""
    pose = head_pose(fitted.camera)
    return json.dumps(
        {
            "model": {"name": model.name, "sha256": model.sha256},
            "camera_matrix": fitted.camera.matrix.tolist(),
            "pose_deg": {name.removesuffix("_deg"): angle for name, angle in asdict(pose).items()},
            "px_per_mm": nearest_weak_perspective(linearised(fitted.camera)).scale,
            "identity": fitted.identity.tolist(),
            "expression": fitted.expression.tolist(),
            "landmarks2d_px": fitted.landmarks2d.tolist(),
            "landmarks3d_mm": fitted.landmarks3d.tolist(),
        },
        indent=1,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``pix2face``."""
    commands: dict[str, Callable[..., int]] = {"predict": predict, "fit": fit}
    return run_commands("pix2face", "Dense 3D faces from photographs.", commands, arguments)


def _for_each_face(config: PredictConfig | FitConfig, predictor: Predictor, write: Callable[[SeenFace], None]) -> int:
    """Finds the faces of all photographs, predicts their maps, and hands each face on.

    A photograph that cannot be read, or has no face, is said and does not end the run; the exit status tells.
    """
    prepare_output_folder(config.out)
    n_faces, problems, taken = 0, [], set[str]()
    with progress_bar(console, "photographs", len(config.images)) as advance:
        for stem, path in zip(_stems(config.images), config.images, strict=True):
            try:
                image = read_photograph(path)
                boxes = _boxes(image, config)
            except (InputFileError, DegenerateGeometryError) as error:
                problems.append(_located(error, path))
                boxes = []
            predictions = predictor.predict_batch([(image, box) for box in boxes]) if boxes else []
            for index, prediction in enumerate(predictions):
                name = _unused(stem if len(boxes) == 1 else f"{stem}-{index}", taken)
                try:
                    write(SeenFace(name, image, prediction))
                    n_faces += 1
                except DegenerateGeometryError as error:
                    problems.append(_located(error, path))
            advance()
    for problem in problems:
        say(console, problem)
    say(console, f"photographs: {len(config.images)}, faces: {n_faces} -> {config.out}")
    return EXIT_REJECTED if problems else 0


def _check_call(config: PredictConfig | FitConfig) -> None:
    """Refuses what can never work, before anything takes time.

    Raises:
        UsageError: No photographs, a box of less than a pixel, or a regularisation that is not positive.
    """
    if not config.images:
        raise UsageError("expected at least one photograph")
    if config.box is not None:
        left, top, right, bottom = config.box
        if not (right - left >= 1 and bottom - top >= 1 and max(abs(side) for side in config.box) <= LARGEST_BOX_PX):
            raise UsageError(f"expected --box left top right bottom, in pixels and in this order, found {config.box}")
    if isinstance(config, FitConfig) and not 0 < config.regularisation < np.inf:
        raise UsageError(f"expected a positive --regularisation in mm^2, found {config.regularisation}")


def _boxes(image: Photograph, config: PredictConfig | FitConfig) -> list[FaceBox]:
    """The boxes to look at, largest first.

    Raises:
        DegenerateGeometryError: There is none, or the one given lies beside the photograph.
    """
    if config.box is not None:
        height, width = image.shape[:2]
        left, top, right, bottom = config.box
        if not (left < width and right > 0 and top < height and bottom > 0):
            raise DegenerateGeometryError(f"--box lies beside the picture of {width} x {height} pixels")
        return [FaceBox(*config.box)]
    boxes = detect_faces(image)
    if not boxes:
        raise DegenerateGeometryError("no face found; say where it is with --box left top right bottom")
    return boxes[:1] if config.largest else boxes


def _located(error: Exception, path: Path) -> str:
    return str(error) if str(path) in str(error) else f"{path}: {error}"


def _stems(images: tuple[Path, ...]) -> list[str]:
    """The stem of each file; those that occur more than once get the number of their photograph, from 000."""
    stems = [path.stem for path in images]
    return [stem if stems.count(stem) == 1 else f"{stem}-{index:03d}" for index, stem in enumerate(stems)]


def _unused(name: str, taken: set[str]) -> str:
    """A name that no other face of this run has, so that nothing is overwritten; capitals make no difference."""
    unused, number = name, 2
    while unused.casefold() in taken:
        unused, number = f"{name}-{number}", number + 1
    taken.add(unused.casefold())
    return unused


def _write_maps(out: Path, face: SeenFace) -> None:
    crop = crop_image(face.image, face.prediction.crop)
    _write_picture(out / f"{face.name}-maps.png", draw_maps(crop, face.prediction.maps))


def _write_picture(path: Path, picture: Photograph) -> None:
    """Writes a picture; unlike OpenCV's own function it takes every name and says when it fails."""
    path.write_bytes(cv2.imencode(path.suffix, picture[..., ::-1])[1].tobytes())


if __name__ == "__main__":
    sys.exit(main())
