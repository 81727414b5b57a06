"""The detector's network in torch, from and to its file."""

from dataclasses import asdict
from pathlib import Path

import torch

from pix2face.inference.centre_files import METADATA_KEY, DetectorHeader, detector_header
from pix2face.inference.torch_networks import fill_network, write_tensors
from pix2face.inference.weight_files import Weights, header_fits_weights, read_arrays
from training.detection.centre_network import CentreNetwork


def save_detector(path: Path, header: DetectorHeader, network: CentreNetwork, precision: torch.dtype) -> None:
    """Writes a network; a file of that name is replaced at once or not at all. Norms and biases stay float32."""
    tensors = {
        name: tensor.to(precision) if tensor.ndim > 1 else tensor for name, tensor in network.state_dict().items()
    }
    write_tensors(path, METADATA_KEY, asdict(header), tensors)


def load_centre_network(path: Path) -> CentreNetwork:
    """Reads what ``save_detector`` wrote; the network computes in float32, whatever its file is in.

    Raises:
        InputFileError: The file is missing, truncated, of another kind, or of a newer schema.
    """
    header = detector_header(path)
    with header_fits_weights(path, "detector"):
        network = CentreNetwork(header.widths, header.neck)
        fill_network(network, Weights(read_arrays(path)))
    return network
