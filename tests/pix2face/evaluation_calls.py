"""Calls of the command ``evaluate`` over small made benchmarks, with a network that has learned nothing."""

import json

import numpy as np
import torch

from pix2face.evaluation.cli import main
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.torch_networks import save_checkpoint
from pix2face.networks.dimensions import paper_widths
from pix2face.networks.paper import UNet
from tests.pix2face.benchmark_files import frontal_camera, landmarks_of, write_photograph, write_pts
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
LANDMARKS = landmarks_of(MODEL, frontal_camera())
PART = ("--allow-missing",)  # none of these benchmarks is whole


def write_checkpoint(path, model_name=MODEL.name, model_sha256=MODEL.sha256, landmarks=None):
    torch.manual_seed(0)
    header = CheckpointHeader(
        model_name=model_name,
        model_sha256=model_sha256,
        size_px=32,
        widths=paper_widths(32, 4),
        pncc_scale_mm=150.0,
        offset_scale_mm=20.0,
        smallest_radius_mm=MODEL.smallest_radius_mm,
        licence="CC0",
        configuration='{"preset": "test"}',
        epoch=2,
        landmarks=landmarks or {},
    )
    save_checkpoint(path, header, UNet(32, 4))
    return path


def run(tmp_path, *arguments, split="ibug"):
    checkpoint = tmp_path / "checkpoint.safetensors"
    if not checkpoint.exists():
        write_checkpoint(checkpoint)
    out = tmp_path / "out"
    return main(["--split", split, "--checkpoint", str(checkpoint), "--out", str(out), *PART, *map(str, arguments)])


def write_ibug(folder, names=("image_003_1", "image_004_1")):
    for name in names:
        write_photograph(folder / "ibug" / f"{name}.jpg")
        write_pts(folder / "ibug" / f"{name}.pts", LANDMARKS)


def predictions_for(path, names):
    np.savez(path, names=names, landmarks=np.stack([LANDMARKS - 0.5] * len(names)))
    return path


def measure(tmp_path, *arguments, split="ibug"):
    call = ["--split", split, "--data", tmp_path, "--out", tmp_path / "out", "--resamples", 20, *PART, *arguments]
    return main([str(argument) for argument in call])


def stored_report(tmp_path):
    return json.loads((tmp_path / "out" / "report.json").read_text())
