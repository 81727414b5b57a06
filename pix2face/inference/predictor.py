"""Predicts maps from pictures: NumPy arrays in and out, torch in between."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import final

import numpy as np
import torch
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray
from torch import Tensor

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.geometry.camera import Camera, affine_camera
from pix2face.geometry.crops import Crop, FaceBox, crop_image, pixels_in_image, square_crop
from pix2face.geometry.maps import FaceMaps, FitCorrector, PredictedLandmarks, eroded, smooth_maps, valid_pixels
from pix2face.inference.checkpoint import CheckpointHeader, load_checkpoint
from pix2face.networks import MAP_PLANES
from pix2face.networks.architectures import MASK_PLANE, SEEN_PLANE
from pix2face.networks.correction import FitCorrection
from pix2face.networks.packed import packed
from pix2face.networks.residual import ResidualUNet

# The network is no faster with more faces at a time, and memory stays small.
FACES_AT_A_TIME = 16


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
        network: From ``b 3 s s`` in [-0.5, 0.5] to ``b planes s s``: maps in units of the header's scales, then logits
            and scales; or to these and landmarks, ``b n 3`` (``pix2face.networks.LANDMARK_NUMBERS``).
        header: Header of its checkpoint.
        device: The device that the network is on.
    """

    def __init__(
        self,
        network: Callable[[Tensor], Tensor | tuple[Tensor, Tensor]],
        header: CheckpointHeader,
        device: torch.device | str = "cpu",
    ) -> None:
        self.header = header
        self._network = network
        self._device = torch.device(device)

    @classmethod
    def load(cls, path: Path, device: str | None = None) -> "Predictor":
        """Opens a checkpoint of a training, or an ONNX file of ``export_onnx`` (.onnx), which runs on the CPU.

        Args:
            path: The file.
            device: Name of a torch device; None uses a GPU if there is one.

        Raises:
            InputFileError: The file is missing, truncated, no checkpoint, or of a newer schema.
            UsageError: There is no such device (ONNX runs on the CPU only), or the package for ONNX is not installed.
        """
        if path.suffix.lower() == ".onnx":
            from pix2face.inference.onnx_export import load_onnx

            if device not in (None, "cpu"):
                raise UsageError(
                    f"{path}: expected --device cpu, where ONNX files run here, found {device!r}; the checkpoint that "
                    "it was exported from runs on any"
                )
            own_header, run = load_onnx(path)
            return cls(run, own_header)
        header, network = load_checkpoint(path)
        chosen = _device(device)
        return cls(packed(network) if chosen.type == "cpu" else network.to(chosen), header, chosen)

    def with_crop_scale(self, crop_scale: float) -> "Predictor":
        """The same network with crops of another size (``CheckpointHeader.crop_scale``)."""
        return Predictor(self._network, replace(self.header, crop_scale=crop_scale), self._device)

    def predict(self, image: UInt8[ndarray, "h w 3"], box: FaceBox) -> Prediction:
        """Predicts the maps of a face in an RGB image. The box (in pixels) is tight around its 68 landmarks."""
        return self.predict_batch([(image, box)])[0]

    def predict_batch(self, faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]]) -> list[Prediction]:
        """Predicts the maps of several faces, each a picture and a box as in ``predict``, in one pass of the network.

        All faces are in memory at once, so use it for a few dozen at most. ``predict_many`` takes any number.
        """
        if not faces:
            return []
        crops = [square_crop(box, self.header.crop_scale, self.header.size_px) for _, box in faces]
        pictures = np.stack([crop_image(image, crop) for (image, _), crop in zip(faces, crops, strict=True)])
        planes, numbers, correctors = self._answers(pictures.astype(np.float32) / 255 - 0.5)
        landmarks = [read_landmarks(own, self.header.size_px) for own in numbers]
        found = [read_planes(own, self.header) for own in planes]
        return [
            Prediction(
                replace(
                    maps, in_photograph=pixels_in_image(crop, image.shape[:2]), landmarks=points, correct=corrector
                ),
                crop,
                box,
                n_undefined=n_undefined,
            )
            for (maps, n_undefined), points, corrector, crop, (image, box) in zip(
                found, landmarks, correctors, crops, faces, strict=True
            )
        ]

    def predict_many(self, faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]]) -> list[Prediction]:
        """Predicts the maps of any number of faces, in several passes of ``predict_batch`` that need little memory."""
        starts = range(0, len(faces), FACES_AT_A_TIME)
        return [own for start in starts for own in self.predict_batch(faces[start : start + FACES_AT_A_TIME])]

    def _answers(
        self, pictures: Float32[ndarray, "b s s 3"]
    ) -> tuple[Float32[ndarray, "b s s planes"], Float32[ndarray, "b n 3"], list[FitCorrector | None]]:
        """Planes, landmarks (none where the network predicts none), and what corrects the fits."""
        network = self._network
        with torch.inference_mode():
            batch = torch.from_numpy(pictures).permute(0, 3, 1, 2).to(self._device)
            correctors: list[FitCorrector | None] = [None] * len(batch)
            if isinstance(network, ResidualUNet) and network.correction is not None:
                planes, landmarks, levels = network.read(batch)
                correction = network.correction
                # Of all pictures at once, when the first fit needs it: maps alone do not.
                seen = cache(lambda: correction.seen([level.float() for level in levels]))
                correctors = [_Corrector(correction, seen, place, self.header.size_px) for place in range(len(batch))]
            else:
                answer = network(batch)
                planes, landmarks = answer if isinstance(answer, tuple) else (answer, None)
            numbers = planes.new_zeros(len(batch), 0, 3) if landmarks is None else landmarks
            last = planes.float().permute(0, 2, 3, 1).cpu().numpy()
            return np.ascontiguousarray(last), numbers.float().cpu().numpy(), correctors


@final
class _Corrector:
    """A ``FitCorrector`` for one picture.

    Args:
        correction: The network's part that corrects fits.
        seen: Returns what it goes by of the pictures of a batch, ``b n``.
        place: Of the picture in its batch.
        size_px: Side of the picture.
    """

    def __init__(self, correction: FitCorrection, seen: Callable[[], Tensor], place: int, size_px: int) -> None:
        self._correction, self._seen, self._place, self._size_px = correction, seen, place, size_px

    def __call__(self, camera: Camera, coefficients: Float64[ndarray, " c"]) -> tuple[Camera, Float64[ndarray, " c"]]:
        """Returns the corrected camera and coefficients."""
        with torch.inference_mode():
            seen, rows = self._seen()[self._place, None], centred_rows(camera, self._size_px)
            fitted = (torch.from_numpy(values[None]).to(seen) for values in (rows, coefficients))
            answer = self._correction.corrected(seen, *fitted)
            nearer, better = (values[0].double().cpu().numpy() for values in answer)
        return camera_of_rows(nearer, self._size_px), better


def centred_rows(camera: Camera, size_px: int) -> Float64[ndarray, "2 4"]:
    """The rows of an affine camera, in units of the picture's side from its middle: what ``FitCorrection`` takes."""
    rows = camera.matrix[:2] / size_px
    rows[:, 3] -= 0.5
    return rows


def camera_of_rows(rows: Float64[ndarray, "2 4"], size_px: int) -> Camera:
    """The inverse of ``centred_rows``."""
    rows = rows.copy()
    rows[:, 3] += 0.5
    return affine_camera(size_px * rows)


def keep_networks_in_one_thread() -> None:
    """Lets networks on the CPU use the calling thread alone, for programs whose own threads use the cores."""
    torch.set_num_threads(1)


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


def read_landmarks(numbers: Float32[ndarray, "n 3"], size_px: int) -> PredictedLandmarks | None:
    """Converts the landmarks that a network predicts for a picture to pixels; None if there are none."""
    if not len(numbers):
        return None
    values = np.nan_to_num(numbers.astype(np.float64), posinf=0, neginf=0)
    return PredictedLandmarks(size_px * (values[:, :2] + 0.5), size_px * np.exp(np.clip(values[:, 2], -20, 20)))


def _device(name: str | None) -> torch.device:
    """The device with a name; None selects a GPU if there is one."""
    try:
        device = torch.device(name or ("cuda" if torch.cuda.is_available() else "cpu"))
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        reason = str(error).splitlines()[0]
        raise UsageError(f"expected a torch device that is there, such as cpu, found {name!r} ({reason})") from error
    return device
