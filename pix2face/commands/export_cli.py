"""The commands ``pix2face export`` and ``page``: networks in, an ONNX file or a page that runs them out."""

import logging
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console

from pix2face.command_line import check_output_file, say
from pix2face.commands.pix2face_config import ExportConfig, PageConfig
from pix2face.detectors.centre_detector import PACKAGED as PACKAGED_DETECTOR
from pix2face.files.writing import write_file
from pix2face.inference import PACKAGED
from pix2face.landmark_choice.landmark_file import open_model_with, with_own_landmarks


def export(config: ExportConfig) -> int:
    """Runs ``pix2face export``."""
    check_output_file(config.out, (".onnx",))
    _quiet_exporter()
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


def page(config: PageConfig) -> int:
    """Runs ``pix2face page``."""
    from pix2face.inference.centre_onnx import export_detector, load_detector_onnx
    from pix2face.inference.onnx_export import export_onnx, load_onnx
    from pix2face.inference.onnx_weights import half_weights
    from pix2face.photographs.reader_page import PageNetworks, reader_page

    check_output_file(config.out, (".html",))
    _quiet_exporter()
    model = open_model_with(config.model, config.landmarks)
    network, detector = config.checkpoint or PACKAGED, config.detector or PACKAGED_DETECTOR
    with TemporaryDirectory() as folder:
        if not _is_onnx(network):
            export_onnx(network, network := Path(folder) / "network.onnx")
        header, _ = load_onnx(network)
        header.check_model(model.name, model.sha256)
        if not _is_onnx(detector):
            export_detector(detector, detector := Path(folder) / "detector.onnx")
        load_detector_onnx(detector)
        networks = PageNetworks(
            half_weights(network),
            header,
            half_weights(detector),
            with_own_landmarks(model, header) if config.landmarks is None else model,
        )
    content = reader_page(networks)
    write_file(config.out, content)
    say(Console(stderr=True), f"{len(content) / 1e6:.1f} MB -> {config.out}")
    return 0


def _quiet_exporter() -> None:
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it warns of packages that nothing here needs


def _is_onnx(path: Path) -> bool:
    return path.suffix.lower() == ".onnx"
