"""The command ``pix2face export``: a checkpoint in, an ONNX file out."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, final

import tyro
from rich.console import Console

from pix2face.command_line import check_output_file, optional, say
from pix2face.inference import PACKAGED


@final
@dataclass(frozen=True)
class ExportConfig:
    """Configuration of ``pix2face export``.

    Attributes:
        checkpoint: Checkpoint that `train` wrote. Default: the one that comes with the package.
        out: ONNX file to write.
    """

    checkpoint: Annotated[Path | None, optional("PATH")] = None
    out: Path = Path("out/network.onnx")


def export(config: Annotated[ExportConfig, tyro.conf.arg(name="")]) -> int:
    """Write the network as ONNX, for any batch size. The metadata contain scales, sizes and the model's hash."""
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
