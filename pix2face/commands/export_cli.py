"""The command ``pix2face export``: a checkpoint in, an ONNX file out."""

import logging

from rich.console import Console

from pix2face.command_line import check_output_file, say
from pix2face.commands.pix2face_config import ExportConfig
from pix2face.detectors.centre_detector import PACKAGED as PACKAGED_DETECTOR
from pix2face.inference import PACKAGED


def export(config: ExportConfig) -> int:
    """Runs ``pix2face export``."""
    check_output_file(config.out, (".onnx",))
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it warns of packages that nothing here needs
    # torch's exporter takes seconds to load
    if config.detector:
        from pix2face.inference.centre_onnx import export_detector

        checkpoint = config.checkpoint or PACKAGED_DETECTOR
        export_detector(checkpoint, config.out)
        what = "a detector of faces"
    else:
        from pix2face.inference.onnx_export import export_onnx

        checkpoint = config.checkpoint or PACKAGED
        header = export_onnx(checkpoint, config.out)
        what = f"{header.size_px} px, {header.filters} filters, for {header.model_name}"
    say(Console(stderr=True), f"{checkpoint}: {what} -> {config.out}")
    return 0
