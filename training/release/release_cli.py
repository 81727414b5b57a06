"""The command ``train export``: a checkpoint in, a release out."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, final

import torch
import tyro
from rich.console import Console

from pix2face.command_line import optional, prepare_output_folder, say
from pix2face.files.writing import write_file
from pix2face.inference.checkpoint import load_checkpoint, save_checkpoint
from pix2face.landmark_choice.landmark_file import load_landmarks
from training.release.model_card import model_card

WEIGHTS_NAME, CARD_NAME, ONNX_NAME = "checkpoint.safetensors", "README.md", "network.onnx"


@final
@dataclass(frozen=True)
class ExportConfig:
    """Configuration of ``train export``.

    Attributes:
        checkpoint: Checkpoint that `train` wrote.
        out: Folder for the release.
        report: Reports of `evaluate` (report.json) whose errors are copied into the model card.
        landmarks: Landmarks that `pix2face landmarks select` chose on fits of this network; the release contains them.
        onnx: Write the network as ONNX as well (pip install 'pix2face[onnx]').
    """

    checkpoint: tyro.conf.Positional[Path]
    out: Path
    report: Annotated[tuple[Path, ...], tyro.conf.arg(help_behavior_hint="")] = ()
    landmarks: Annotated[Path | None, optional("PATH")] = None
    onnx: bool = True


def export(config: Annotated[ExportConfig, tyro.conf.arg(name="")]) -> int:
    """Write the weights as float16 safetensors, a model card, and the same weights as ONNX."""
    console = Console(stderr=True)
    header, network = load_checkpoint(config.checkpoint)
    if config.landmarks is not None:
        choice = load_landmarks(config.landmarks)
        header.check_model(choice.model_name, choice.model_sha256)
        header = replace(header, landmarks={**header.landmarks, choice.scheme: choice.vertices})
    prepare_output_folder(config.out)
    weights = config.out / WEIGHTS_NAME
    save_checkpoint(weights, header, network, torch.float16)
    written = [weights, config.out / CARD_NAME]
    write_file(written[1], model_card(header, weights, config.report))
    if config.onnx:
        from pix2face.inference.onnx_export import export_onnx  # torch's exporter takes seconds to load

        logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it warns of packages that nothing here needs
        written.append(config.out / ONNX_NAME)
        export_onnx(weights, written[-1])  # of the weights as they were rounded, so that both compute the same
    for path in written:
        say(console, f"{path}: {path.stat().st_size / 1e6:.1f} MB")
    return 0
