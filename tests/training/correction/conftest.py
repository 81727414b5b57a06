"""A small network with random weights for the small head."""

from pathlib import Path

import pytest
import torch

from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.torch_networks import save_checkpoint
from pix2face.networks.dimensions import residual_widths
from pix2face.networks.residual import ResidualUNet
from tests.synthetic_models import small_head_model


@pytest.fixture(scope="session")
def network_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its maps hold a face everywhere."""
    model, widths = small_head_model(), residual_widths(4)
    torch.manual_seed(0)
    header = CheckpointHeader(
        model_name=model.name,
        model_sha256=model.sha256,
        size_px=64,
        widths=widths,
        pncc_scale_mm=120.0,
        offset_scale_mm=20.0,
        smallest_radius_mm=model.smallest_radius_mm,
        licence="CC0-1.0",
        configuration="{}",
        epoch=1,
        architecture="residual",
        planes=7,
    )
    network = ResidualUNet(widths, 7)
    torch.nn.init.constant_(network.planes.bias[24:], 10.0)  # the mask
    path = tmp_path_factory.mktemp("network") / "checkpoint.safetensors"
    save_checkpoint(path, header, network.eval())
    return path
