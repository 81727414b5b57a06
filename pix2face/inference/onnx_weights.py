"""Smaller ONNX files: weights in float16, from which a runtime makes float32 when it opens the file."""

from pathlib import Path
from typing import Any

import numpy as np

from pix2face.inference.onnx_export import optional_package

_HALF = "_float16"


def half_weights(path: Path) -> bytes:
    """The network of an ONNX file with its weights in half the space.

    It still computes in float32: each weight goes through a node that converts it. Vectors (norms and biases) stay
    float32, as in checkpoints.

    Raises:
        UsageError: The package for ONNX is not installed.
    """
    onnx = optional_package("onnx")
    model = onnx.load(str(path))
    graph = model.graph
    casts = [_halve(onnx, weight) for weight in graph.initializer if _is_worth_it(onnx, weight)]
    nodes = [*casts, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
    return bytes(model.SerializeToString())


def _is_worth_it(onnx: Any, weight: Any) -> bool:
    return weight.data_type == onnx.TensorProto.FLOAT and len(weight.dims) > 1


def _halve(onnx: Any, weight: Any) -> Any:
    """Changes a weight to float16 under another name, and returns the node that makes the former from it."""
    name = weight.name
    values = onnx.numpy_helper.to_array(weight).astype(np.float16)
    weight.CopyFrom(onnx.numpy_helper.from_array(values, name + _HALF))
    return onnx.helper.make_node("Cast", [name + _HALF], [name], to=onnx.TensorProto.FLOAT)
