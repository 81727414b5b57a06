"""The detector's network as ONNX, for programs without torch."""

import json
import warnings
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32, UInt8
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.json_text import JsonObject, parse_json, typed
from pix2face.files.opening import read_regular
from pix2face.files.writing import written_in_one_step
from pix2face.inference.centre_files import METADATA_KEY, CentreAnswers, DetectorHeader, load_centre_network
from pix2face.inference.onnx_export import LARGEST_FILE_BYTES, OPSET, optional_package
from pix2face.networks.centre import MULTIPLE, folded

INPUT_NAME, OUTPUT_NAME = "pictures", "cells"


def export_detector(detector: Path, out: Path) -> None:
    """Writes a detector that ``train detector`` wrote as ONNX, for any number of pictures of any size.

    Raises:
        InputFileError: The detector is missing or unusable.
        UsageError: The packages for ONNX are not installed.
    """
    onnx = optional_package("onnx")
    optional_package("onnxscript")
    header, network = load_centre_network(detector)
    dim = torch.export.Dim
    rows, columns = dim("rows", min=1, max=256), dim("columns", min=1, max=256)
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # the exporter warns of its own future
        program = torch.onnx.export(
            folded(network),
            (torch.zeros(2, 3, 2 * MULTIPLE, 3 * MULTIPLE),),
            input_names=[INPUT_NAME],
            output_names=[OUTPUT_NAME],
            dynamic_shapes=({0: dim("batch", min=1), 2: MULTIPLE * rows, 3: MULTIPLE * columns},),
            opset_version=OPSET,
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    model = program.model_proto
    onnx.helper.set_model_props(model, {METADATA_KEY: json.dumps(asdict(header), sort_keys=True)})
    model.producer_name = "pix2face"
    with written_in_one_step(out) as temporary:
        onnx.save(model, str(temporary))


def load_detector_onnx(path: Path) -> tuple[DetectorHeader, CentreAnswers]:
    """Opens what ``export_detector`` wrote, to run on the CPU by onnxruntime.

    Raises:
        InputFileError: The file is missing, truncated or not ours.
        UsageError: onnxruntime is not installed.
    """
    runtime = optional_package("onnxruntime")
    content = read_regular(path, "an ONNX file", LARGEST_FILE_BYTES)
    try:
        session = runtime.InferenceSession(content, providers=["CPUExecutionProvider"])
        fields = parse_json(session.get_modelmeta().custom_metadata_map[METADATA_KEY], JsonObject)
        header: DetectorHeader = typed(fields, DetectorHeader)
    except Exception as error:  # the runtime's errors have no base of their own
        raise InputFileError(f"{path}: expected a detector as ONNX, found another file ({error})") from error

    def answers(pictures: UInt8[ndarray, "b h w 3"]) -> Float32[ndarray, "b y x 5"]:
        batch = np.ascontiguousarray(pictures.transpose(0, 3, 1, 2), dtype=np.float32) / 255 - np.float32(0.5)
        cells = session.run([OUTPUT_NAME], {INPUT_NAME: batch})[0]
        return np.ascontiguousarray(cells.transpose(0, 2, 3, 1))

    return header, answers
