"""The command ``pix2face export``: a checkpoint in, an ONNX file out."""

import logging

from rich.console import Console

from pix2face.command_line import check_output_file, say
from pix2face.commands.pix2face_config import ExportConfig
from pix2face.inference import PACKAGED


def export(config: ExportConfig) -> int:
    """Runs ``pix2face export``."""
    from pix2face.inference.onnx_export import export_onnx  # torch's exporter takes seconds to load

    check_output_file(config.out, (".onnx",))
    checkpoint = config.checkpoint or PACKAGED
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it warns of packages that nothing here needs
    header = export_onnx(checkpoint, config.out)
    say(
        Console(stderr=True),
        f"{checkpoint}: {header.size_px} px, {header.filters} filters, for {header.model_name} -> {config.out}",
    )
    return 0
