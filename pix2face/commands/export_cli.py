"""The commands ``pix2face export``, which writes a network as ONNX, and ``page``, which writes a page that runs it."""

from pathlib import Path

from rich.console import Console

from pix2face.command_line import check_output_file, say
from pix2face.commands.pix2face_config import ExportConfig, PageConfig
from pix2face.detectors.centre_detector import PACKAGED as PACKAGED_DETECTOR
from pix2face.files.writing import write_file
from pix2face.inference import PACKAGED
from pix2face.inference.centre_files import export_detector, load_detector
from pix2face.inference.onnx_files import export_onnx, export_parts, load_onnx
from pix2face.landmark_choice.landmark_file import open_model_with, with_own_landmarks
from pix2face.photographs.reader_page import PageNetworks, reader_page


def export(config: ExportConfig) -> int:
    """Runs ``pix2face export``."""
    check_output_file(config.out, (".onnx",))
    if config.detector:
        checkpoint = config.checkpoint or PACKAGED_DETECTOR
        content, what = export_detector(checkpoint), "a detector of faces"
    else:
        checkpoint = config.checkpoint or PACKAGED
        header, content = export_onnx(checkpoint)
        what = f"{header.size_px} px, {header.widths[0]} filters, for {header.model_name}"
    write_file(config.out, content)
    say(Console(stderr=True), f"{checkpoint}: {what} -> {config.out}")
    return 0


def page(config: PageConfig) -> int:
    """Runs ``pix2face page``."""
    check_output_file(config.out, (".html",))
    model = open_model_with(config.model, config.landmarks)
    checkpoint, detector = config.checkpoint or PACKAGED, config.detector or PACKAGED_DETECTOR
    if _is_onnx(checkpoint):
        header, parts = load_onnx(checkpoint)[0], [checkpoint.read_bytes()]
    else:
        header, parts = export_parts(checkpoint)
    header.check_model(model.name, model.sha256)
    if _is_onnx(detector):
        load_detector(detector)
        finder = detector.read_bytes()
    else:
        finder = export_detector(detector, half=True)
    own_model = with_own_landmarks(model, header) if config.landmarks is None else model
    content = reader_page(PageNetworks(parts, header, finder, own_model, uses_own_landmarks=config.landmarks is None))
    write_file(config.out, content)
    say(Console(stderr=True), f"{len(content) / 1e6:.1f} MB -> {config.out}")
    return 0


def _is_onnx(path: Path) -> bool:
    return path.suffix.lower() == ".onnx"
