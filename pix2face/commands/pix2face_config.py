"""The options of the commands of ``pix2face``. This module imports nothing that takes long to load."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, final

import tyro

from pix2face.command_line import optional
from pix2face.detectors import DEFAULT_DETECTOR, SURE_SCORE
from pix2face.errors import UsageError
from pix2face.fitting.fit_options import DEFAULT_FIT, FitOptions
from pix2face.inference import PACKAGED
from pix2face.models import BUILTIN_MODEL
from pix2face.tracking import IDENTITY_FRAMES, Smoothing

Colour = Literal["auto", "none", "vertex", "texture"]


@final
@dataclass(frozen=True)
class NetworkOptions:
    """Which network, and the morphable model that it was trained for.

    Attributes:
        checkpoint: Checkpoint that `train` wrote. Default: the one that comes with the package.
        model: `builtin`, or the model file that the checkpoint was trained for.
        landmarks: File from `pix2face landmarks select` that says where the landmarks are. Default: the landmarks in
            the checkpoint. If it has none, and for renders, those of the model.
        device: `cpu`, or a device of PyTorch, such as cuda. Default: a GPU, if there is one and PyTorch is installed.
    """

    checkpoint: Annotated[Path | None, optional("PATH")] = None
    model: str = BUILTIN_MODEL
    landmarks: Annotated[Path | None, optional("PATH")] = None
    device: Annotated[str | None, optional("STR")] = None

    @property
    def path(self) -> Path:
        """The checkpoint, named or packaged."""
        return self.checkpoint or PACKAGED


@final
@dataclass(frozen=True)
class FaceOptions:
    """Which network, and where the faces are.

    Attributes:
        network: Network and model.
        boxes: File of face boxes to use instead of a detector: JSON, or CSV with the header
            image,left,top,right,bottom. For videos, the first column is frame, counted from 0, as in boxes.csv, which
            is written by `pix2face track`.
        detector: Detector that finds faces: cnn (the network that comes with the package), dlib (as in the paper; pip
            install 'pix2face[dlib]'), or a file that `train detector` or `pix2face export --detector` wrote.
        min_score: Smallest score of a detected face. The higher the score, the surer the detector.
        smallest_face: Longer side of the smallest faces to find, as a share of the longer side of the picture. Smaller
            shares take longer. Default: about 0.05 for cnn and 0.08 for dlib.
        refine: Correct each box by a first prediction. In photographs, boxes in which it finds no face are rejected.
    """

    network: Annotated[NetworkOptions, tyro.conf.arg(name="")] = NetworkOptions()
    boxes: Annotated[Path | None, optional("PATH")] = None
    detector: str = DEFAULT_DETECTOR
    min_score: float = SURE_SCORE
    smallest_face: Annotated[float | None, optional("FLOAT")] = None
    refine: bool = True


@final
@dataclass(frozen=True)
class PhotographOptions:
    """Which network, and where the faces of photographs are.

    Attributes:
        faces: Network, boxes and detector.
        box: Face box in pixels, tight around the 68 landmarks, to use instead of a detector.
        largest: Take only the largest face of each photograph.
    """

    faces: Annotated[FaceOptions, tyro.conf.arg(name="")] = FaceOptions()
    box: Annotated[tuple[float, float, float, float] | None, optional("LEFT TOP RIGHT BOTTOM")] = None
    largest: bool = False

    def check(self) -> None:
        """Checks the box before anything takes time.

        Raises:
            UsageError: The box is smaller than a pixel or beyond a million, or boxes are given twice.
        """
        if self.box is None:
            return
        from pix2face.face_files.box_files import LARGEST_BOX_PX  # loads NumPy

        if self.faces.boxes is not None:
            raise UsageError("expected --box or --boxes, found both")
        left, top, right, bottom = self.box
        if not (right - left >= 1 and bottom - top >= 1 and max(abs(side) for side in self.box) <= LARGEST_BOX_PX):
            raise UsageError(f"expected --box left top right bottom, in pixels and in this order, found {self.box}")


@final
@dataclass(frozen=True)
class PredictConfig:
    """Predict the maps of every face (PNCC and offset in mm, mask), and draw them as NAME-0-maps.png.

    Attributes:
        images: Photographs: files, folders of them, or quoted patterns such as 'photos/*.jpg'.
        faces: Network, model and face boxes.
        out: Folder for the maps.
        format: Formats of the maps, separated by commas: npz, png16 (16-bit PNG), exr (32-bit OpenEXR).
        resolution: That of the network, whose maps are written as they are; or that of the photograph (at most 4,096
            pixels a side), for which they are smoothed and enlarged.
    """

    images: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(help_behavior_hint="(required)")]
    faces: Annotated[PhotographOptions, tyro.conf.arg(name="")] = PhotographOptions()
    out: Path = Path("out/predict")
    format: str = "npz"
    resolution: Literal["network", "photograph"] = "network"


@final
@dataclass(frozen=True)
class FitConfig:
    """Fit a camera and a mesh to every face. Write NAME-0.json (largest face), landmarks, mesh, points and pictures.

    Attributes:
        images: Photographs: files, folders of them, or quoted patterns such as 'photos/*.jpg'.
        faces: Network, model and face boxes.
        out: Folder for fits, meshes, point clouds and overlays.
        how: Camera and coefficients.
        joint: Fit one identity to all photographs, and one expression to each. They must show the same person; the
            largest face of each photograph is used.
        mesh: Formats of the mesh, separated by commas: obj, ply, glb, usdz; or none. glb (glTF) and usdz (USD) contain
            the camera; usdz needs pip install 'pix2face[usd]'.
        colour: Colours of the mesh, taken from the photograph: vertex, texture or none; auto uses a texture if the
            model has texture coordinates, and vertex colours otherwise. A .ply has vertex colours instead of a texture.
    """

    images: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(help_behavior_hint="(required)")]
    faces: Annotated[PhotographOptions, tyro.conf.arg(name="")] = PhotographOptions()
    out: Path = Path("out/fit")
    how: Annotated[FitOptions, tyro.conf.arg(name="")] = DEFAULT_FIT
    joint: bool = False
    mesh: str = "obj,glb"
    colour: Colour = "auto"


@final
@dataclass(frozen=True)
class TrackConfig:
    """Follow faces through a video. Write landmarks and poses of all frames, an identity, an overlay and the jitter.

    Attributes:
        video: Video file, folder of frames, or pattern such as frames/%05d.png.
        out: Folder for boxes, landmarks, overlay and summary.
        faces: Network, model and face boxes.
        detect_every: Run the detector on every n-th frame only; boxes in between are interpolated.
        all_faces: Follow every face through the frames that show it. By default, only the main face is followed.
        smoothing: How the 2D landmarks are smoothed: none, mean3 (mean of three frames, as in the paper),
            one-euro (uses no later frames) or spline (smoothest).
        how: Camera and coefficients of each frame.
        identity_frames: Largest number of frames that the identity is fitted to. They are spread evenly over the clip.
        write: What to write, separated by commas: csv (landmarks.csv), npz (track.npz), pts (a file for each frame),
            video (overlay.mp4), glb and usdc (the moving mesh with its camera as glTF and USD; USD needs the extra
            usd), and arkit (arkit.csv: weights of ARKit's blendshapes in the form of Live Link Face).
    """

    video: Annotated[Path, tyro.conf.Positional]
    out: Path = Path("out/track")
    faces: Annotated[FaceOptions, tyro.conf.arg(name="")] = FaceOptions()
    detect_every: int = 1
    all_faces: bool = False
    smoothing: Smoothing = "mean3"
    how: Annotated[FitOptions, tyro.conf.arg(name="")] = DEFAULT_FIT
    identity_frames: int = IDENTITY_FRAMES
    write: Annotated[str, tyro.conf.arg(metavar="csv,npz,pts,video,glb,usdc,arkit")] = "csv,npz,video"


@final
@dataclass(frozen=True)
class ViewConfig:
    """Write a page on which you can turn the fitted mesh and point cloud of every face beside its photograph.

    Attributes:
        inputs: Photographs, which are fitted first, or fits (.json) that `pix2face fit` wrote: files, folders of
            photographs, or quoted patterns such as 'photos/*.jpg'.
        faces: Network, model and face boxes.
        out: Page to write; any browser opens it without a network connection. More than 10 faces are spread over pages
            that lead to each other: view.html, view-2.html and so on.
        how: Camera and coefficients of photographs.
    """

    inputs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(help_behavior_hint="(required)")]
    faces: Annotated[PhotographOptions, tyro.conf.arg(name="")] = PhotographOptions()
    out: Path = Path("out/view.html")
    how: Annotated[FitOptions, tyro.conf.arg(name="")] = DEFAULT_FIT


@final
@dataclass(frozen=True)
class ExportConfig:
    """Write a network as ONNX, for any batch size. The metadata contain scales, sizes and the model's hash.

    Attributes:
        checkpoint: Checkpoint that `train` or `train detector` wrote. Default: the one that comes with the package.
        detector: Export a face detector instead of a network for maps.
        out: ONNX file to write.
    """

    checkpoint: Annotated[Path | None, optional("PATH")] = None
    detector: bool = False
    out: Path = Path("out/network.onnx")


@final
@dataclass(frozen=True)
class PageConfig:
    """Write a page that finds faces in the photographs of whoever opens it, in the browser. Nothing is uploaded.

    Attributes:
        checkpoint: Checkpoint that `train` wrote, or ONNX file of `pix2face export`. Default: the one that comes with
            the package.
        model: `builtin`, or the model file that the checkpoint was trained for.
        landmarks: File from `pix2face landmarks select` that says where the 68 landmarks are. Default: the landmarks in
            the checkpoint, or else those of the model.
        detector: Face detector that `train detector` or `pix2face export --detector` wrote. Default: the one that comes
            with the package.
        out: Page to write. It contains the networks and needs no other file.
    """

    checkpoint: Annotated[Path | None, optional("PATH")] = None
    model: str = BUILTIN_MODEL
    landmarks: Annotated[Path | None, optional("PATH")] = None
    detector: Annotated[Path | None, optional("PATH")] = None
    out: Path = Path("out/reader.html")


@dataclass(frozen=True)
class LandmarksSelectConfig:
    """Choose landmarks, vertices with offsets, by their mean reprojection error over annotated frames.

    Attributes:
        data: Folder of annotated photographs, with its subfolders. Annotations are .pts files beside the pictures, .mat
            files of AFLW2000-3D, or .xml files of dlib.
        out: File to write, for the option --landmarks of other commands.
        scheme: Scheme of the annotated points. ibug68-2d is for points that people marked in photographs: .pts and .xml
            files, and --landmark-type 2d.
        network: The network whose predicted maps are fitted, as in the paper, and the model.
        coeffs: Use the fits in this table, which `datagen fit` wrote, instead of predictions. They are matched by name.
        folds: Number of parts that the frames are divided into. Each part is held out in turn to test the landmarks
            that are chosen on the others.
    """

    data: Path
    out: Path = Path("landmarks.json")
    scheme: Literal["ibug68", "ibug68-2d", "inner51", "aflw21", "menpo84"] = "ibug68"
    network: Annotated[NetworkOptions, tyro.conf.arg(name="")] = NetworkOptions()
    coeffs: Annotated[Path | None, optional("PATH")] = None
    folds: int = 5


@dataclass(frozen=True)
class LandmarksShowConfig:
    """Draw the mean face in three views, with its landmarks in green and those of a file in red.

    Attributes:
        file: File that `pix2face landmarks select` wrote.
        out: Picture to write (.png or .jpg).
        scheme: Landmarks of the model to draw if no file is given.
        model: `builtin`, or a model file.
    """

    file: Annotated[Path | None, tyro.conf.Positional, optional("PATH")] = None
    out: Path = Path("landmarks.png")
    scheme: str = "ibug68"
    model: str = BUILTIN_MODEL


LandmarksCommand = (
    Annotated[LandmarksSelectConfig, tyro.conf.subcommand("select")]
    | Annotated[LandmarksShowConfig, tyro.conf.subcommand("show")]
)
