"""What batches save in an evaluation: faces through predictor and subject, one at a time and several at once.

    python -m tests.benchmarks.evaluation

Pictures are noise and the weights are random: neither changes the time. One thread; CPU time, the least of several
rounds that take turns.
"""

import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from pix2face.evaluation.figures.bootstrap import Bootstrap, intervals, mean_of, median_of
from pix2face.geometry.crops import FaceBox
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.onnx_session import keep_networks_in_one_thread
from pix2face.inference.predictor import Predictor
from pix2face.inference.torch_networks import save_checkpoint
from pix2face.networks.dimensions import paper_widths
from pix2face.networks.paper import UNet
from tests.benchmarks.surroundings import surroundings, write_report

N_FACES, ROUNDS = 16, 4
BATCHES = (1, 4, 16)


def main() -> None:
    """Prints the figures."""
    keep_networks_in_one_thread()
    figures = {f"{size} px, {filters} filters": network_ms(size, filters) for size, filters in ((64, 32), (128, 32))}
    result = {
        "surroundings": surroundings(),
        "network_ms_a_face_by_batch": figures,
        "bootstrap_ms": bootstrap_ms(),
    }
    write_report(result)


def network_ms(size_px: int, filters: int) -> dict[str, float]:
    """Milliseconds a face, by batch size, cropping included."""
    torch.manual_seed(0)
    header = CheckpointHeader(
        model_name="none",
        model_sha256="0" * 64,
        size_px=size_px,
        widths=paper_widths(size_px, filters),
        pncc_scale_mm=150.0,
        offset_scale_mm=20.0,
        smallest_radius_mm=60.0,
        licence="CC0",
        configuration="{}",
        epoch=0,
    )
    with TemporaryDirectory() as folder:
        save_checkpoint(Path(folder) / "c.safetensors", header, UNet(size_px, filters))
        predictor = Predictor.load(Path(folder) / "c.safetensors", "cpu")
    image = np.random.default_rng(0).integers(0, 255, (450, 450, 3)).astype(np.uint8)
    faces = [(image, FaceBox(100, 100, 300, 320))] * N_FACES
    least = dict.fromkeys(BATCHES, float("inf"))
    for _ in range(ROUNDS):
        for batch in BATCHES:
            start = time.process_time()
            for first in range(0, N_FACES, batch):
                predictor.predict_batch(faces[first : first + batch])
            least[batch] = min(least[batch], (time.process_time() - start) / N_FACES * 1000)
    return {str(batch): round(milliseconds, 2) for batch, milliseconds in least.items()}


def bootstrap_ms() -> dict[str, float]:
    """Milliseconds for mean and median of 2,000 images and of 20,000 frames in 60 clips, 1,000 draws."""
    times = {}
    for name, n, n_clusters in (("2000 images", 2000, 2000), ("20000 frames of 60 clips", 20000, 60)):
        errors = np.random.default_rng(0).gamma(2, 0.02, n)
        start = time.process_time()
        intervals({"mean": mean_of(errors), "median": median_of(errors)}, np.arange(n) % n_clusters, Bootstrap())
        times[name] = round((time.process_time() - start) * 1000, 1)
    return times


if __name__ == "__main__":
    main()
