"""The options of the commands of ``train``. Nothing that takes long to load is imported here."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, final

import tyro

from pix2face.command_line import choices, optional
from pix2face.errors import InputFileError, UsageError
from pix2face.files.json_text import JsonObject, read_json_file, typed
from pix2face.inference import RUNS
from training.recipe.correction_recipe import CorrectionRecipe
from training.recipe.detector_recipe import DetectorRecipe
from training.recipe.presets import PRESETS, PresetName
from training.recipe.recipe import Recipe

TrackerName = Literal["wandb", "trackio"]

# The options of a training, in its folder.
CONFIGURATION_NAME = "configuration.json"
LARGEST_CONFIGURATION_BYTES = 1 << 20
# Options of one call, which are not stored.
OF_ONE_CALL = frozenset(("config", "restart", "dry_run"))


@final
@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Configuration of ``train``; its defaults are those of a preset.

    Attributes:
        shards: Folders of shards, all of one morphable model. FOLDER:0.7 gives a folder its share of the draws.
        preset: Values of all options that describe the training. paper: 256 px, 60 epochs of 100,000 pictures; needs a
            GPU. tiny: two minutes on two cores. cpu: 128 px, residual network, half an hour on two idle cores. gpu: the
            same network at 256 px. `train --preset NAME --help` shows its values.
        config: File of options, such as the configuration.json that each training writes into its folder. Options on
            the command line win. Without --out, the training in that folder continues.
        out: Folder for the checkpoint, the log, and the state from which an interrupted training continues.
        init: Checkpoint whose weights the training starts from. The residual network is fully convolutional and can
            continue at another size, so most of a training can run on small pictures.
        samples: Number of pictures of the whole training, instead of --epochs; rounded up to whole epochs of the same
            size.
        mirror: Mirror every other sample. The paper does not do this. It is refused if the model is not symmetric.
        numbers: Network, length, optimisation and crops.
        where: Train only on samples whose attributes fulfil this condition, such as "abs(yaw_deg) < 60".
        validation: Share of the persons that are held out for validation; 0 for no validation.
        validation_samples: Largest number of pictures of these persons that are used for validation.
        validate_every: Number of pictures between two validations. Default: validation after each epoch.
        restart: Replace the training in the output folder.
        state_minutes: Minutes after which the state of the training is saved again. It is also saved at the end of an
            epoch and on a signal.
        compile: Compile the network with torch.compile, which takes a minute and needs a C++ compiler.
        tensorboard: Write curves and pictures for TensorBoard into the output folder (pip
            install 'pix2face[tensorboard]').
        tracker: Also log the curves with this package (pip install wandb, or trackio), in the project pix2face and
            under the name of the output folder.
        dry_run: Run a few steps with one batch, print time and memory, and write no files.
        workers: Number of processes that load samples. Default: one for every second core, at most 8.
        cache_gb: Memory for decoded samples, in 10^9 bytes, for all workers together.
        device: Torch device, such as cpu, cuda or cuda:1. Default: a GPU if there is one.
    """

    shards: Annotated[tuple[str, ...], tyro.conf.arg(help_behavior_hint="(required)")] = ()
    preset: PresetName = "paper"
    config: Annotated[Path | None, optional("PATH")] = None
    out: Path = RUNS / "paper"
    init: Annotated[Path | None, optional("PATH")] = None
    samples: Annotated[int | None, optional("INT")] = None
    mirror: Literal["yes", "no"] = "no"
    numbers: Annotated[Recipe, tyro.conf.arg(name="")] = PRESETS["paper"]
    where: Annotated[str, tyro.conf.arg(help_behavior_hint="")] = ""
    validation: float = 0.0
    validation_samples: int = 200
    validate_every: Annotated[int | None, optional("INT")] = None
    restart: bool = False
    state_minutes: float = 10.0
    compile: bool = False
    tensorboard: bool = False
    tracker: Annotated[TrackerName | None, optional(choices(TrackerName))] = None
    dry_run: bool = False
    workers: Annotated[int | None, optional("INT")] = None
    cache_gb: float = 1.0
    device: Annotated[str | None, optional("STR")] = None

    @classmethod
    def of_preset(cls, preset: PresetName) -> "TrainConfig":
        """The defaults of a preset."""
        recipe = PRESETS[preset]
        mirror: Literal["yes", "no"] = "yes" if recipe.jitter.mirror else "no"
        return cls(preset=preset, out=RUNS / preset, mirror=mirror, numbers=recipe)

    @classmethod
    def of_file(cls, path: Path) -> "TrainConfig":
        """The options in a file. What it leaves out has the values of its preset.

        Raises:
            InputFileError: It is no file of options of ``train``, or has others.
        """
        expected = "a JSON file of options of `train`"
        given = read_json_file(path, JsonObject, expected, LARGEST_CONFIGURATION_BYTES)
        defaults = cls.of_preset(next((name for name in PRESETS if name == given.get("preset")), "paper"))
        unknown: list[str] = []
        options = _overridden(json.loads(defaults.as_json()), given, unknown)
        if unknown:
            raise InputFileError(f"{path}: expected {expected}, found unknown ones: {', '.join(unknown)}")
        numbers = {field.name: options.pop(field.name) for field in fields(Recipe)}
        try:
            config: TrainConfig = typed({**options, "numbers": numbers, "config": str(path)}, cls)
        except ValueError as error:
            raise InputFileError(f"{path}: expected {expected}, found another value ({error})") from error
        return config

    def as_json(self) -> str:
        """The options as a file that ``of_file`` reads."""
        options = {name: value for name, value in asdict(self).items() if name not in OF_ONE_CALL}
        return json.dumps(options | options.pop("numbers"), indent=1, default=str) + "\n"

    def recipe(self) -> Recipe:
        """The recipe that the options ask for.

        Raises:
            UsageError: A number makes no sense.
        """
        recipe = replace(self.numbers, jitter=replace(self.numbers.jitter, mirror=self.mirror == "yes"))
        recipe.check()
        return recipe if self.samples is None else self._of_samples(recipe, self.samples)

    def _of_samples(self, recipe: Recipe, samples: int) -> Recipe:
        """The recipe for so many pictures, in epochs of about the size that it has."""
        if recipe.epochs != PRESETS[self.preset].epochs:
            raise UsageError("--samples: expected it or --epochs, found both")
        if samples <= 0:
            raise UsageError(f"--samples: expected more than 0, found {samples}")
        epochs = math.ceil(samples / recipe.epoch_size)
        return replace(recipe, epochs=epochs, epoch_size=math.ceil(samples / epochs))


def defaults_of(arguments: Sequence[str]) -> TrainConfig:
    """The options that a command line starts from: those of its file, or else of its preset.

    Raises:
        InputFileError: As ``TrainConfig.of_file``.
        UsageError: There is a file and a preset, or ``--resume``.
    """
    if "--resume" in arguments:
        raise UsageError(
            "--resume: there is no such option; the same command with the same --out continues an interrupted training"
        )
    path, preset = _value_of("--config", arguments), _value_of("--preset", arguments)
    if path is None:
        return TrainConfig.of_preset(next((name for name in PRESETS if name == preset), "paper"))
    if preset is not None:
        raise UsageError("expected --config or --preset, found both; a file of options has its preset in it")
    return TrainConfig.of_file(Path(path))


def _value_of(option: str, arguments: Sequence[str]) -> str | None:
    """What a command line gives for an option; its last value counts."""
    value = None
    for word, following in pairwise([*arguments, ""]):
        if word.split("=")[0] == option:
            value = word.partition("=")[2] or following
    return value


def _overridden(defaults: JsonObject, given: JsonObject, unknown: list[str], place: str = "") -> JsonObject:
    """Values with those given in their place; names that have no default are added to ``unknown``."""
    unknown += [f"{place}{name}" for name in given if name not in defaults]
    merged = {**defaults, **given}
    for name, value in defaults.items():
        if isinstance(value, dict) and isinstance(merged[name], dict):
            merged[name] = _overridden(value, merged[name], unknown, f"{place}{name}.")
    return merged


@final
@dataclass(frozen=True, kw_only=True)
class DetectorConfig:
    """Train the face detector on rendered people in front of pictures without people.

    After an interruption, run the same command again to continue.

    Attributes:
        shards: Folders of shards with the layers image, coverage and landmarks.
        backgrounds: Folder of pictures that show nobody, such as `datagen empty` draws.
        things: Folders of drawings on transparent backgrounds, which are pasted beside the people: PNG files such as
            those of Debian's package openclipart-png. They must not show human faces.
        out: Folder for the detector, the log, and the state from which an interrupted training continues.
        init: Detector whose weights the training starts from. Default: random weights.
        numbers: Length and optimisation.
        workers: Number of processes that compose scenes.
        device: Torch device, such as cpu or cuda.
        state_minutes: Minutes between two writings of the state from which an interrupted training continues.
        restart: Replace the training in the output folder.
    """

    shards: tuple[str, ...]
    backgrounds: Path
    things: Annotated[tuple[Path, ...], tyro.conf.arg(help_behavior_hint="")] = ()
    out: Path = RUNS / "detector"
    init: Annotated[Path | None, optional("PATH")] = None
    numbers: Annotated[DetectorRecipe, tyro.conf.arg(name="")] = field(default_factory=DetectorRecipe)
    workers: int = 1
    device: str = "cpu"
    state_minutes: float = 10.0
    restart: bool = False


@final
@dataclass(frozen=True, kw_only=True)
class CorrectionConfig:
    """Train what corrects the fits of a network, together with the network, on rendered faces.

    The network is run on crops of the faces, and the model is fitted to its maps. The correction learns how the fits
    differ from the true faces; the network continues to learn the maps. After an interruption, run the same command
    again to continue.

    Attributes:
        shards: Folders of shards.
        checkpoint: Network of the architecture residual. If it corrects its fits already, the training starts from
            that. Default: the network that comes with the package.
        model: Morphable model of the network: builtin, or a file of `datagen model`.
        out: Folder for the network with its correction, the log, and the state from which an interrupted training
            continues.
        numbers: Length and optimisation.
        workers: Number of processes that load samples.
        device: Torch device of the network, such as cpu or cuda.
        state_minutes: Minutes between two writings of the state from which an interrupted training continues.
        restart: Replace the training in the output folder.
    """

    shards: tuple[str, ...]
    checkpoint: Annotated[Path | None, optional("PATH")] = None
    model: str = "builtin"
    out: Path = RUNS / "correction"
    numbers: Annotated[CorrectionRecipe, tyro.conf.arg(name="")] = field(default_factory=CorrectionRecipe)
    workers: int = 1
    device: str = "cpu"
    state_minutes: float = 10.0
    restart: bool = False


@final
@dataclass(frozen=True)
class ExportConfig:
    """Write the weights as float16 safetensors, a model card, and the same weights as ONNX.

    Attributes:
        checkpoint: Checkpoint that `train` wrote.
        out: Folder for the release.
        report: Reports of `evaluate` (report.json) whose errors are copied into the model card.
        landmarks: Files of landmarks that `pix2face landmarks select` chose on fits of this network, one for each
            scheme; the release contains them.
        onnx: Write the network as ONNX as well.
    """

    checkpoint: tyro.conf.Positional[Path]
    out: Path
    report: Annotated[tuple[Path, ...], tyro.conf.arg(help_behavior_hint="")] = ()
    landmarks: Annotated[tuple[Path, ...], tyro.conf.arg(help_behavior_hint="")] = ()
    onnx: bool = True
