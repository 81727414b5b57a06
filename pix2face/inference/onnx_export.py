"""Exports networks to ONNX, for programs without torch, and loads them (layout: docs/reference/file_formats.md)."""

import json
import warnings
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from pix2face.errors import InputFileError, UsageError
from pix2face.files.json_text import Integer, JsonObject, parse_json, typed
from pix2face.files.opening import is_regular, read_regular
from pix2face.files.writing import written_in_one_step
from pix2face.inference.checkpoint import METADATA_KEY, SCHEMA_VERSION, CheckpointHeader, load_checkpoint

INPUT_NAME, OUTPUT_NAME, LANDMARKS_NAME = "image", "maps", "landmarks"
OPSET = 18
LARGEST_FILE_BYTES = 1 << 30  # larger weights lie in a file of their own, which is not read
DESCRIPTION = (
    "image: RGB crop of a face, pixel / 255 - 0.5, (batch, 3, size, size). maps: PNCC x, y, z times pncc_scale_mm and "
    "offset x, y, z times offset_scale_mm are millimetres in the model's frame; a pixel is face where plane 6, "
    "where there is one, is above 0, else where |PNCC| exceeds smallest_radius_mm / 2, eroded by one pixel "
    "(not where the picture ends); plane 7, where there is one, is above 0 where the face is seen; plane 8, where "
    "there is one, is the logarithm of the expected error of PNCC, in its unit. landmarks, where the network "
    "predicts them: x and y from the middle of the crop, and the logarithm of the scale of their error, in units of "
    f"its side. The scales are in the metadata entry {METADATA_KEY!r} (JSON)."
)


def export_onnx(checkpoint: Path, out: Path) -> CheckpointHeader:
    """Writes the network of a checkpoint as ONNX, with the checkpoint's header as JSON in its metadata.

    The batch may have any size. The correction of fits is not part of the file. An existing file is replaced in one
    step or not at all. The folder is created.

    Raises:
        InputFileError: The checkpoint is missing, truncated, foreign, or of a newer schema.
        UsageError: The packages for ONNX are not installed.
    """
    onnx = optional_package("onnx")
    optional_package("onnxscript")
    header, network = load_checkpoint(checkpoint)
    # Two pictures, since a batch of one would be taken for a constant.
    example = torch.zeros(2, 3, header.size_px, header.size_px)
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # the exporter warns of its own future
        program = torch.onnx.export(
            network,
            (example,),
            input_names=[INPUT_NAME],
            output_names=[OUTPUT_NAME, LANDMARKS_NAME][: 1 + (header.n_landmarks > 0)],
            dynamic_shapes=({0: torch.export.Dim("batch", min=1)},),
            opset_version=OPSET,
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    model, header = program.model_proto, replace(header, n_corrected=0)
    onnx.helper.set_model_props(model, {METADATA_KEY: json.dumps(asdict(header), sort_keys=True)})
    model.doc_string = DESCRIPTION
    model.producer_name = "pix2face"
    with written_in_one_step(out) as temporary:
        onnx.save(model, str(temporary))
    return header


def load_onnx(path: Path) -> tuple[CheckpointHeader, Callable[[Tensor], Tensor | tuple[Tensor, Tensor]]]:
    """Opens an ONNX file of ``export_onnx``, to run on the CPU with onnxruntime.

    Raises:
        InputFileError: The file is missing, truncated, not ours, or of a newer schema.
        UsageError: onnxruntime is not installed.
    """
    runtime = optional_package("onnxruntime")
    if not is_regular(path):
        raise InputFileError(f"{path}: no such file; `pix2face export` writes ONNX files")
    content = read_regular(path, "an ONNX file", LARGEST_FILE_BYTES)
    try:
        session = runtime.InferenceSession(content, providers=["CPUExecutionProvider"])
    except Exception as error:  # the runtime's errors have no base of their own
        raise InputFileError(f"{path}: expected an ONNX file, found one that cannot be read ({error})") from error
    try:
        fields = parse_json(session.get_modelmeta().custom_metadata_map[METADATA_KEY], JsonObject)
        if typed(fields.get("schema_version"), Integer) > SCHEMA_VERSION:
            raise InputFileError(f"{path}: schema {fields['schema_version']} is newer than {SCHEMA_VERSION}; upgrade")
        header = CheckpointHeader.from_json(fields)
    except (KeyError, ValueError) as error:
        raise InputFileError(f"{path}: expected a network that `pix2face export` wrote, found another one") from error

    def network(images: Tensor) -> Tensor | tuple[Tensor, Tensor]:
        found = session.run(None, {INPUT_NAME: images.cpu().contiguous().numpy()})
        maps, *landmarks = (torch.from_numpy(values) for values in found)
        return (maps, landmarks[0]) if landmarks else maps

    return header, network


def optional_package(name: str) -> Any:
    """A package of the extra ``onnx``.

    Raises:
        UsageError: It is not installed.
    """
    try:
        return __import__(name)
    except ImportError as error:
        raise UsageError(f"expected the package {name}, which ONNX needs; run: pip install 'pix2face[onnx]'") from error
