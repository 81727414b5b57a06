"""Predicts maps from pictures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.geometry.crops import Crop, FaceBox, crop_image, pixels_in_image, square_crop
from pix2face.geometry.maps import FaceMaps, FitCorrector, PredictedLandmarks, eroded, smooth_maps, valid_pixels
from pix2face.inference.answers import Answers, Network
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.fit_correction import FitCorrection
from pix2face.inference.onnx_files import load_onnx, open_network
from pix2face.inference.weight_files import Weights
from pix2face.networks import MAP_PLANES, MASK_PLANE, SEEN_PLANE

# The network is hardly faster with more faces at a time, and memory stays small.
FACES_AT_A_TIME = 16
# The packaged network was trained with crops that are turned by up to 10 degrees
# (docs/explanation/detection_and_tracking.md has its errors on turned photographs).
TILTED_RAD = np.radians(25)
# The tilt is measured at about this number of pixels.
TILT_PIXELS = 500
# What there is where a GPU may be that torch can use.
GPU_DRIVERS = Path("/dev/nvidiactl"), Path("/dev/kfd"), Path("/dev/dxg")


@final
@dataclass(frozen=True, eq=False)
class Prediction:
    """The prediction for one face."""

    maps: FaceMaps  #: in the pixels of the crop
    crop: Crop  #: converts to pixels of the picture and back
    box: FaceBox  #: where the network looked, pixels of the picture
    score: float | None = None  #: score of the detection; None if the box was given
    n_undefined: int = 0  #: pixels where the network's output is not finite; they are outside the mask

    def smooth(self, size_px: int) -> "Prediction":
        """The prediction in another size, without roughness and blocks (``smooth_maps``), for other programs.

        It keeps PNCC, offset and mask only. Fit the maps as the network answered them instead.

        Args:
            size_px: Side of the maps. That of the picture's own resolution is ``crop.finest_size_px``.
        """
        return replace(self, maps=smooth_maps(self.maps, size_px), crop=self.crop.with_size(size_px))

    def check_finite(self) -> None:
        """Checks that the network's output was finite.

        Raises:
            DegenerateGeometryError: It was not, so the weights are unusable.
        """
        if self.n_undefined:
            n_pixels = self.maps.mask.size
            raise DegenerateGeometryError(
                f"expected finite maps from the network, found {self.n_undefined} of {n_pixels} pixels that are not; "
                "its training diverged or its checkpoint is damaged: choose another with --checkpoint"
            )


@final
class Predictor:
    """A network with its pre- and postprocessing. It keeps no state between calls.

    Args:
        network: Predicts the planes of crops.
        header: Header of its checkpoint.
        correction: Corrects fits to its maps, if it can.
    """

    def __init__(self, network: Network, header: CheckpointHeader, correction: FitCorrection | None = None) -> None:
        self.header = header
        self._network = network
        self._correction = correction

    @classmethod
    def load(cls, path: Path, device: str | None = None) -> "Predictor":
        """Opens a checkpoint of a training, or an ONNX file of ``export_onnx`` (.onnx), which runs on the CPU.

        On the CPU, onnxruntime computes, and torch is not loaded.

        Args:
            path: The file.
            device: "cpu", or the name of a device of torch; None uses a GPU if there is one.

        Raises:
            InputFileError: The file is missing, truncated, no checkpoint, or of a newer schema.
            UsageError: There is no such device (ONNX runs on the CPU only).
        """
        if path.suffix.lower() == ".onnx":
            if device not in (None, "cpu"):
                raise UsageError(
                    f"{path}: expected --device cpu, where ONNX files run here, found {device!r}; the checkpoint that "
                    "it was exported from runs on any"
                )
            own_header, run = load_onnx(path)
            return cls(run, own_header)
        if device == "cpu" or (device is None and not any(driver.exists() for driver in GPU_DRIVERS)):
            header, run, correction = open_network(path)
            return cls(run, header, correction)
        return _on_device(path, device)

    def with_crop_scale(self, crop_scale: float) -> "Predictor":
        """The same network with crops of another size (``CheckpointHeader.crop_scale``)."""
        return Predictor(self._network, replace(self.header, crop_scale=crop_scale), self._correction)

    def predict(self, image: UInt8[ndarray, "h w 3"], box: FaceBox) -> Prediction:
        """Predicts the maps of a face in an RGB image. The box (in pixels) is tight around its 68 landmarks."""
        return self.predict_batch([(image, box)])[0]

    def predict_batch(self, faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]]) -> list[Prediction]:
        """Predicts the maps of several faces, each a picture and a box as in ``predict``.

        Faces are predicted in one pass of the network, in crops that are turned as the boxes say. Those that are tilted
        are predicted in a second pass, in crops that show them upright. This needs a network that predicts landmarks.

        All faces are in memory at once, so use it for a few dozen at most. ``predict_many`` takes any number.
        """
        predictions = self._predictions(faces, self._crops(faces))
        upright = {
            place: crop for place, own in enumerate(predictions) if (crop := self._upright_crop(own)) is not None
        }
        again = self._predictions([faces[place] for place in upright], list(upright.values()))
        for place, prediction in zip(upright, again, strict=True):
            predictions[place] = prediction
        return predictions

    def predict_many(self, faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]]) -> list[Prediction]:
        """Predicts the maps of any number of faces, in several passes of ``predict_batch`` that need little memory."""
        starts = range(0, len(faces), FACES_AT_A_TIME)
        return [own for start in starts for own in self.predict_batch(faces[start : start + FACES_AT_A_TIME])]

    def predict_landmarks(
        self, faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]]
    ) -> list[tuple[Crop, PredictedLandmarks]]:
        """Predicts landmarks alone, in pixels of the crops, with a network that predicts them itself.

        On the CPU, this takes half the time of ``predict_many``.
        """
        found = []
        for start in range(0, len(faces), FACES_AT_A_TIME):
            several = faces[start : start + FACES_AT_A_TIME]
            crops = self._crops(several)
            numbers = self._network.landmarks(_network_input(several, crops))
            found += [(crop, read_landmarks(own, crop.size_px)) for crop, own in zip(crops, numbers, strict=True)]
        return found

    def _crops(self, faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]]) -> list[Crop]:
        return [square_crop(box, self.header.crop_scale, self.header.size_px) for _, box in faces]

    def _predictions(
        self, faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]], crops: Sequence[Crop]
    ) -> list[Prediction]:
        """Predicts the maps of faces in given crops, in one pass."""
        if not faces:
            return []
        answers = self._network.answers(_network_input(faces, crops))
        predictions = []
        for place, (crop, (image, box)) in enumerate(zip(crops, faces, strict=True)):
            maps, n_undefined = read_planes(answers.planes[place], self.header)
            maps = replace(
                maps,
                in_photograph=pixels_in_image(crop, image.shape[:2]),
                landmarks=None
                if answers.landmarks is None
                else read_landmarks(answers.landmarks[place], self.header.size_px),
                correct=self._corrector(answers, place),
            )
            predictions.append(Prediction(maps, crop, box, n_undefined=n_undefined))
        return predictions

    def _upright_crop(self, prediction: Prediction) -> Crop | None:
        """A crop that shows a tilted face upright; None if the face is not tilted, or the network has no landmarks."""
        landmarks = prediction.maps.landmarks
        if landmarks is None:
            return None
        tilt = _tilt(prediction.maps)
        if abs(tilt) <= TILTED_RAD and not prediction.box.turn_deg:  # the boxes of turned faces are rough
            return None
        cos, sin = np.cos(tilt), np.sin(tilt)
        from_turned = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        try:
            box = FaceBox.around(landmarks.points2d @ from_turned[:2, :2])
        except DegenerateGeometryError:
            return None
        crop = square_crop(box, self.header.crop_scale, self.header.size_px)
        return replace(crop, image_from_crop=prediction.crop.image_from_crop @ from_turned @ crop.image_from_crop)

    def _corrector(self, answers: Answers, place: int) -> FitCorrector | None:
        if self._correction is None or answers.seen is None:
            return None
        return partial(self._correction.corrected, answers.seen[place], size_px=self.header.size_px)


def _network_input(
    faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]], crops: Sequence[Crop]
) -> Float32[ndarray, "b s s 3"]:
    pictures = np.stack([crop_image(image, crop) for (image, _), crop in zip(faces, crops, strict=True)])
    return pictures.astype(np.float32) / 255 - 0.5


def _tilt(maps: FaceMaps) -> float:
    """The angle (radians) by which a head leans to the right in its picture; 0 without enough pixels.

    It is that of the y axis of the model in the affine camera that projects PNCC to the pixels.
    """
    rows, columns = np.nonzero(maps.mask)
    step = max(1, len(rows) // TILT_PIXELS)
    rows, columns = rows[::step], columns[::step]
    points = np.column_stack([maps.pncc[rows, columns].astype(np.float64), np.ones(len(rows))])
    camera, _, rank, _ = np.linalg.lstsq(points, np.column_stack([columns, rows]).astype(np.float64))
    right, down = camera[1]
    return float(np.arctan2(right, -down)) if rank == points.shape[1] else 0.0


def _on_device(path: Path, name: str | None) -> Predictor:
    """A checkpoint that torch runs, unless no device is named and torch or a GPU is missing."""
    try:
        from pix2face.inference.torch_networks import TorchNetwork, load_checkpoint, torch_device
    except (ImportError, OSError) as error:  # OSError: of an installation whose libraries cannot be loaded
        if name is None:
            return Predictor.load(path, "cpu")
        raise UsageError(
            f"expected --device cpu, or PyTorch, which {name!r} needs; run: pip install 'pix2face[train]' ({error})"
        ) from error
    device = torch_device(name)
    if name is None and device.type == "cpu":
        return Predictor.load(path, "cpu")
    header, network = load_checkpoint(path)
    arrays = {weight: own.numpy() for weight, own in network.state_dict().items()}
    correction = FitCorrection.of(Weights(arrays), header.n_corrected) if header.n_corrected else None
    return Predictor(TorchNetwork(network, device), header, correction)


def read_planes(planes: Float32[ndarray, "s s planes"], header: CheckpointHeader) -> tuple[FaceMaps, int]:
    """Converts a network's output to maps in mm, 0 outside the mask, and counts the pixels that are not finite.

    The planes hold maps in units of the header's scales, then logits of masks, if any. They are overwritten.
    """
    is_finite = np.isfinite(planes)
    undefined = np.zeros(planes.shape[:2], bool) if is_finite.all() else ~is_finite.all(axis=2)
    planes[undefined] = 0
    pncc = planes[..., :3] * np.float32(header.pncc_scale_mm)
    offset = planes[..., 3:MAP_PLANES] * np.float32(header.offset_scale_mm)
    # Where the network does not say it, PNCC does, by how far it is from the background's.
    is_told = header.planes > MASK_PLANE
    mask = eroded(planes[..., MASK_PLANE] > 0) if is_told else valid_pixels(pncc, header.smallest_radius_mm)
    mask &= ~undefined
    outside = np.flatnonzero(~mask)
    pncc.reshape(-1, 3)[outside] = 0
    offset.reshape(-1, 3)[outside] = 0
    seen = mask & (planes[..., SEEN_PLANE] > 0) if header.planes > SEEN_PLANE else None
    return FaceMaps(pncc, offset, mask, seen), int(undefined.sum())


def read_landmarks(numbers: Float32[ndarray, "n 3"], size_px: int) -> PredictedLandmarks:
    """Converts the landmarks that a network predicts for a picture to pixels."""
    values = np.nan_to_num(numbers.astype(np.float64), posinf=0, neginf=0)
    return PredictedLandmarks(size_px * (values[:, :2] + 0.5), size_px * np.exp(np.clip(values[:, 2], -20, 20)))
