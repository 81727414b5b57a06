"""The options of the commands of ``datagen``. This module imports nothing that takes long to load."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, final

import tyro

from datagen.opengl import Rasteriser
from pix2face.command_line import optional
from pix2face.models import BUILTIN_MODEL

Through = Literal["dense", "landmarks"]  # how two models are related


@dataclass(frozen=True)
class SampleConfig:
    """Draw plausible faces, poses and cameras, and write them as a table of coefficients.

    Attributes:
        out: Table of coefficients to write (.h5).
        n: Number of faces.
        seed: Seed of identities, expressions, poses and cameras. 0 is an ordinary seed.
        size: Side of the pictures to be rendered, in pixels.
        appearance: Distribution of the faces: `default`, `hard`, `plain`, or a TOML file, of which this command uses
            only the table [geometry] (docs/explanation/sampling.md).
        model: `builtin`, or a model file made by `datagen model import`.
    """

    out: Path
    n: int = 400
    seed: int = 0
    size: int = 256
    appearance: str = "default"
    model: str = BUILTIN_MODEL


@dataclass(frozen=True)
class ShowConfig:
    """Print the configuration of synthetic photographs as TOML, with an explanation of every setting.

    Edit the output and pass the file to `datagen sample` and `datagen render` as --appearance. You may delete lines;
    their values then come from the preset.

    Attributes:
        appearance: `plain`, `default`, `hard`, or a TOML file.
    """

    appearance: Annotated[str, tyro.conf.Positional] = "default"


@dataclass(frozen=True)
class RenderConfig:
    """Render image / PNCC / offset triplets into sharded HDF5. One bad sample never ends the job.

    Ctrl-C and SIGTERM stop it cleanly (a second one at once). Finished shards are kept, and the same command continues.

    Attributes:
        coeffs: Folder of 300W-LP or AFLW2000-3D files (with subfolders), or a table (.h5) made by `datagen
            sample`, `datagen fit` or `datagen coeffs convert`.
        out: Folder of the shards. Running the same command again completes it. It is refused if settings, the table or
            the files of the source have changed. A file that was edited without changing its size is not noticed.
        model: `builtin`, or a model file made by `datagen model import`. An imported BFM 2009 uses the coefficients
            of 300W-LP as they are; any other model is fitted to the landmarks of the files.
        appearance: How faces without photographs are drawn: `plain`, `default`, `hard`, or a TOML file as `datagen
            appearance` prints it (docs/explanation/synthetic_photographs.md). Default: `default` for the built-in
            model, and `plain` for other models, which can have no other.
        backgrounds: Folder of your own pictures (with subfolders) to use as backgrounds. `folder_share` of the
            appearance is the share of the synthetic photographs that have one.
        layers: Layers of each sample: `all`, or some of image, pncc, offset, mask, depth, normals, uv, regions and
            landmarks, separated by commas. Synthetic photographs also have three others: seen is the visible part of
            the face, coverage is how much of each pixel is not backdrop, and seen_regions says what is nearest in each
            pixel. Default: image, pncc, offset, mask, landmarks, and seen for synthetic photographs.
        plain: Store the maps as plain numbers in their unit (float32), for programs that read HDF5 and do not decode
            it. Shards are then about 2.4 times as large.
        seed: Seed of light, colours and background of rendered pictures, and of the jitter.
        shard_size: Faces in a shard. One process makes a whole shard, so a small set needs small shards to use all
            processes.
        jitter: Number of variants of each face that take its place: crops of 1 to 1.8 times its box, shifted, turned,
            with other gamma and colours. `train` does not need them: it varies every sample anew each time.
        jitter_size: Side of such variants, in pixels.
        jitter_mirror: Mirror every other variant. Refused if the model is not symmetric.
        workers: Number of processes that render on this machine.
        scheduler: Render on the workers of this Dask scheduler instead, such as
            tcp://host:8786 (docs/how_to/render_many_samples.md). Its connections are neither encrypted nor
            authenticated, so anyone who can reach it can run code on its workers.
        gl: OpenGL backend. Default: EGL, or OSMesa if EGL fails.
        device: Number of the GPU, as `datagen doctor` lists them.
        rasteriser: What draws the maps. `processor` needs no OpenGL, and `compute` needs OpenGL 4.3. On a GPU, `auto`
            takes the latter, and elsewhere the former.
        max_rejected: Largest number of rejected samples for which the exit status is still 0; with more, it is 3.
    """

    coeffs: Path
    out: Path
    model: str = BUILTIN_MODEL
    appearance: Annotated[str | None, optional("STR")] = None
    backgrounds: Annotated[Path | None, optional("PATH")] = None
    layers: Annotated[str | None, optional("STR")] = None
    plain: bool = False
    seed: int = 0
    shard_size: int = 100
    jitter: int = 0
    jitter_size: int = 256
    jitter_mirror: bool = False
    workers: int = os.cpu_count() or 1
    scheduler: Annotated[str | None, optional("STR")] = None
    gl: Annotated[Literal["egl", "osmesa"] | None, optional("{egl,osmesa}")] = None
    device: Annotated[int | None, optional("INT")] = None
    rasteriser: Rasteriser = "auto"
    max_rejected: int = 0


@final
@dataclass(frozen=True, kw_only=True)
class EmptyConfig:
    """Draw pictures without people, for training a detector (`train detector`) and measuring its false alarms.

    Attributes:
        out: Folder of the pictures to write.
        n: Number of pictures.
        seed: Seed of all pictures.
        size: Side of the pictures, in pixels.
        held_out: Draw only environments, patterns and pictures that are never drawn without this option. Use these for
            measuring.
    """

    out: Path
    n: int = 4000
    seed: int = 0
    size: int = 320
    held_out: bool = False


@dataclass(frozen=True)
class DoctorConfig:
    """Report which OpenGL is installed, compare test renders with the reference, and name the remedy for each problem.

    The exit status is 0 if renders can be trusted, and 2 if not.

    Attributes:
        gl: Check only this backend: `egl` or `osmesa`. Default: PIX2FACE_GL, otherwise EGL and then OSMesa.
        device: Check this device of EGL's list, which starts at 0. Default: PIX2FACE_GL_DEVICE, otherwise EGL's first
            device.
        rasteriser: Check this rasteriser. Default: PIX2FACE_RASTERISER, otherwise `compute` if the driver has
            OpenGL 4.3.
        json: Print everything as JSON instead of tables.
    """

    gl: Annotated[str | None, optional("STR")] = None
    device: Annotated[int | None, optional("INT")] = None
    rasteriser: Rasteriser = "auto"
    json: bool = False


@dataclass(frozen=True)
class ModelImportConfig:
    """Convert a published model to the project's own file and frame. The model is recognised by its files' content.

    Attributes:
        path: BFM 2009: folder with Model_Shape.mat and Model_Expression.mat (as 300W-LP needs it), or
            with 01_MorphableModel.mat; BFM 2017 or 2019: the .h5; FLAME: the .pkl; Surrey: the .bin; ICT-FaceKit: the
            folder; GNM: the .npz.
        out: Model file to write (.h5).
        without: Regions to leave out, such as `neck`. `datagen model info` lists the regions of a model.
    """

    path: Annotated[Path, tyro.conf.Positional]
    out: Path
    without: Annotated[tuple[str, ...], tyro.conf.arg(help_behavior_hint="")] = ()


@dataclass(frozen=True)
class ModelInfoConfig:
    """Print sizes, extents, components, variance, landmarks, licence and hash of a model.

    Attributes:
        model: `builtin`, or a model file.
    """

    model: Annotated[str, tyro.conf.Positional] = BUILTIN_MODEL


@dataclass(frozen=True)
class ModelViewConfig:
    """Draw the mean face and ±3 standard deviations of the first components, or write the mean face as a mesh.

    Attributes:
        model: `builtin`, or a model file.
        out: File to write: a contact sheet (.jpg or .png), or the mean face (.obj, .glb or .ply).
        components: Number of identity components and of expression components that the sheet shows.
    """

    model: Annotated[str, tyro.conf.Positional] = BUILTIN_MODEL
    out: Path = Path("model.jpg")
    components: int = 4


ModelCommand = (
    Annotated[ModelImportConfig, tyro.conf.subcommand("import", prefix_name=False)]
    | Annotated[ModelInfoConfig, tyro.conf.subcommand("info", prefix_name=False)]
    | Annotated[ModelViewConfig, tyro.conf.subcommand("view", prefix_name=False)]
)


@dataclass(frozen=True, kw_only=True)
class ConversionConfig:
    """Options of the commands that write tables of photographs.

    Attributes:
        out: Table to write (.h5). Faces that cannot be used are listed in NAME.rejected.jsonl beside it.
        model: `builtin`, or a model file made by `datagen model import`.
        workers: Number of processes that read and fit.
        max_rejected: Largest number of rejected faces for which the exit status is still 0; with more, it is 3.
    """

    out: Path
    model: str = BUILTIN_MODEL
    workers: int = os.cpu_count() or 1
    max_rejected: int = 0


@dataclass(frozen=True, kw_only=True)
class CoeffsConvertConfig(ConversionConfig):
    """Read a folder of 300W-LP or AFLW2000-3D files into one table.

    With an imported BFM 2009, the table contains the coefficients of the files (in standard deviations). Any other
    model is fitted to their landmarks.

    Attributes:
        source: Folder of .mat files with their pictures, including subfolders.
    """

    source: Annotated[Path, tyro.conf.arg(name="from")]


@dataclass(frozen=True, kw_only=True)
class FitConfig(ConversionConfig):
    """Fit a model to photographs with annotated landmarks: camera, identity and expression of each face.

    Attributes:
        landmarks: Folder of photographs with 68 annotated points per face: .pts files as in 300-W, .mat files with
            pt3d_68, or .xml lists of dlib.
    """

    landmarks: Path


@dataclass(frozen=True)
class CoeffsInfoConfig:
    """Print the model, poses, coefficients and attributes of the faces, and say what is rare and what was rejected.

    Attributes:
        source: A table (.h5), or a folder of 300W-LP or AFLW2000-3D files.
    """

    source: Annotated[Path, tyro.conf.Positional]


@dataclass(frozen=True)
class CoeffsRetargetConfig:
    """Convert a table of one model to another model, and print the residual.

    Attributes:
        source: Table of coefficients (.h5).
        to: The other model: `builtin`, or a model file.
        out: Table to write (.h5).
        from_model: The model of the table.
        through: How the two models are related: `dense` by the nearest points of their mean faces, `landmarks` by
            the 68 landmarks alone.
    """

    source: Annotated[Path, tyro.conf.arg(name="from")]
    to: str
    out: Path
    from_model: str = BUILTIN_MODEL
    through: Through = "dense"


CoeffsCommand = (
    Annotated[CoeffsConvertConfig, tyro.conf.subcommand("convert", prefix_name=False)]
    | Annotated[CoeffsInfoConfig, tyro.conf.subcommand("info", prefix_name=False)]
    | Annotated[CoeffsRetargetConfig, tyro.conf.subcommand("retarget", prefix_name=False)]
)


@final
@dataclass(frozen=True)
class VerifyConfig:
    """Read every sample of a folder of shards and check it.

    This checks the schema, checksums, ranges and pictures, and whether layers agree. It also finds ids that occur
    twice, shards of another job and missing shards. For photographs, it finds ground truth that cannot be right:
    landmarks outside the picture, coefficients that no real face has, faces that look away from the camera, and
    pictures that an orientation tag turns.

    Attributes:
        shards: Folder of shards.
        upgrade: First convert shards that an earlier version wrote to today's layout, and write the card anew. A shard
            is replaced when its copy is complete and has the same content. If the command is interrupted, run it again.
    """

    shards: Annotated[Path, tyro.conf.Positional]
    upgrade: bool = False


@final
@dataclass(frozen=True)
class PreviewConfig:
    """Draw samples and their layers, on a contact sheet or on an HTML page (--out page.html).

    The page is one file with all its pictures. Arrow keys change the sample and the layer, and a slider blends layer
    and picture. Visible landmarks are green, and hidden ones are red. A landmark is hidden by the head itself or, if
    the set has the layer `seen`, by something in front of it.

    Attributes:
        shards: Folder of shards.
        out: File to write: a contact sheet (.jpg, .png) or a page (.html). Default: `preview.jpg` in the folder.
        n: Number of samples to show, evenly spread. Without this option, a sheet has 16 and a page 24.
    """

    shards: Annotated[Path, tyro.conf.Positional]
    out: Annotated[Path | None, optional("PATH")] = None
    n: Annotated[int | None, optional("INT")] = None


@final
@dataclass(frozen=True)
class StatsConfig:
    """Print statistics of poses, faces, landmarks and attributes of a folder of shards, and say what is rare.

    Attributes:
        shards: Folder of shards.
        everything: Print all tables, with every range and value. Without this option, only the most important ones are
            printed, on two screens. The page always has all tables.
        out: Also write the statistics as a page (.html) or a picture (.png).
        json: Print everything as JSON instead of tables.
        where: Count only samples that fulfil this condition, such as "abs(yaw_deg) < 60", written as for `train`.
    """

    shards: Annotated[Path, tyro.conf.Positional]
    everything: Annotated[bool, tyro.conf.arg(name="all")] = False
    out: Annotated[Path | None, optional("PATH")] = None
    json: bool = False
    where: Annotated[str, tyro.conf.arg(help_behavior_hint="")] = ""


@final
@dataclass(frozen=True)
class CardConfig:
    """Write a card into a folder of shards: its content and sources, what may not be passed on, and how to read it.

    The file croissant.json has the same content for programs (Croissant 1.1). `datagen render` also writes both files
    when it is done.

    Attributes:
        shards: Folder of shards.
    """

    shards: Annotated[Path, tyro.conf.Positional]


@final
@dataclass(frozen=True)
class ExportConfig:
    """Write the samples of a folder of shards as picture files for compositors and other programs.

    Files are numbered: 000000, 000001, ... NUMBER.json has the id, the camera, the landmarks, the coefficients and the
    attributes of the sample. Running the same command again writes what is missing.

    Attributes:
        shards: Folder of shards.
        out: Folder of the files to write.
        format: `exr` writes one file for each sample, with all layers as channels: R, G and B in linear light, PNCC as
            Pref, offset, mask and, if the shards have them, Z, N, UV and others. `png` writes the picture as it is, and
            one PNG file of 8 or 16 bits for each layer (docs/reference/file_formats.md).
    """

    shards: Annotated[Path, tyro.conf.Positional]
    out: Path
    format: Literal["exr", "png"] = "exr"
