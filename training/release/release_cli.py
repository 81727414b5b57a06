"""The command ``train export``: a checkpoint in, a release out."""

from dataclasses import replace

import torch
from rich.console import Console

from pix2face.command_line import prepare_output_folder, say
from pix2face.files.writing import write_file
from pix2face.inference.onnx_files import export_onnx
from pix2face.inference.torch_networks import load_checkpoint, save_checkpoint
from pix2face.landmark_choice.landmark_file import load_landmarks
from training.release.model_card import ONNX_NAME, model_card
from training.train_config import ExportConfig

WEIGHTS_NAME, CARD_NAME = "checkpoint.safetensors", "README.md"


def export(config: ExportConfig) -> int:
    """Runs ``train export``."""
    console = Console(stderr=True)
    header, network = load_checkpoint(config.checkpoint)
    for path in config.landmarks:
        choice = load_landmarks(path)
        header.check_model(choice.model.name, choice.model.sha256)
        header = replace(
            header,
            landmarks={**header.landmarks, choice.scheme: choice.vertices},
            landmark_offsets_mm={**header.landmark_offsets_mm, choice.scheme: choice.offsets_mm},
        )
    prepare_output_folder(config.out)
    weights = config.out / WEIGHTS_NAME
    save_checkpoint(weights, header, network, torch.float16)
    written = [weights, config.out / CARD_NAME]
    write_file(written[1], model_card(header, weights, config.report, ONNX_NAME if config.onnx else None))
    if config.onnx:
        written.append(config.out / ONNX_NAME)
        # Of the weights as they were rounded, so that both compute the same.
        write_file(written[-1], export_onnx(weights)[1])
    for path in written:
        say(console, f"{path}: {path.stat().st_size / 1e6:.1f} MB")
    return 0
