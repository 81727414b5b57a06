"""Halving the weights of an ONNX file changes little but its size."""

from pathlib import Path

import numpy as np
import pytest

from pix2face.inference.onnx_weights import half_weights

onnx = pytest.importorskip("onnx", reason="pip install 'pix2face[onnx]'")
onnxruntime = pytest.importorskip("onnxruntime", reason="pip install 'pix2face[onnx]'")


def test_it_computes_the_same_with_half_the_bytes(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    weights, bias = rng.normal(size=(200, 300)).astype(np.float32), rng.normal(size=300).astype(np.float32)
    helper, numpy_helper = onnx.helper, onnx.numpy_helper
    graph = helper.make_graph(
        [helper.make_node("Gemm", ["x", "weights", "bias"], ["y"])],
        "layer",
        [helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, [2, 200])],
        [helper.make_tensor_value_info("y", onnx.TensorProto.FLOAT, [2, 300])],
        [numpy_helper.from_array(weights, "weights"), numpy_helper.from_array(bias, "bias")],
    )
    path = tmp_path / "whole.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10), str(path))
    halved = half_weights(path)
    onnx.checker.check_model(onnx.load_from_string(halved), full_check=True)
    assert len(halved) < 0.52 * path.stat().st_size
    session = onnxruntime.InferenceSession(halved, providers=["CPUExecutionProvider"])
    x = rng.normal(size=(2, 200)).astype(np.float32)
    (found,) = session.run(["y"], {"x": x})
    np.testing.assert_allclose(found, x @ weights.astype(np.float16).astype(np.float32) + bias, rtol=1e-4, atol=1e-4)
    assert np.abs(found - (x @ weights + bias)).max() > 1e-4  # that the weights are in half precision
