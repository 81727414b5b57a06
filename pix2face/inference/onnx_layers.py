"""The layers of networks as nodes of an ONNX graph, from the weights of a checkpoint.

Norms are folded into the convolutions before them; the bounds of the innermost ones remain.
"""

from typing import final

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from pix2face.inference.onnx_graph import OnnxGraph
from pix2face.inference.weight_files import Weights
from pix2face.networks.dimensions import FARTHEST, VARIANCE_FLOOR


@final
class Layers:
    """Layers as nodes of a graph. Each takes its weights and returns the name of its output.

    Args:
        graph: The graph.
        weights: The weights of the network.
    """

    def __init__(self, graph: OnnxGraph, weights: Weights) -> None:
        self.graph, self._weights = graph, weights

    def convolution(
        self,
        x: str,
        name: str,
        before: int,
        after: int,
        kernel: int,
        *,
        stride: int = 1,
        norm: str | None = None,
        is_bounded: bool = False,
        has_bias: bool = False,
        kept: int | None = None,
    ) -> str:
        """A convolution with the batch norm after it, if that has a name.

        ``kept`` is the number of planes that are computed, the first ones; None for all.

        Raises:
            ValueError: An array is missing or has another shape.
        """
        weight = self._weights.take(f"{name}.weight", after, before, kernel, kernel)
        shift = self._weights.take(f"{name}.bias", after) if has_bias else None
        bounds: dict[str, Float32[ndarray, " c"]] = {}
        if norm is not None:
            mean, deviation = self._weights.take_norm(norm, after)
            gain, centre = (self._weights.take(f"{norm}.{part}", after) for part in ("weight", "bias"))
            with np.errstate(all="ignore"):
                weight = weight * (gain / deviation)[:, None, None, None]
                shift = centre - mean * gain / deviation
                if is_bounded:
                    bounds = {"Max": centre - FARTHEST * np.abs(gain), "Min": centre + FARTHEST * np.abs(gain)}
        arrays = [weight] if shift is None else [weight, shift]
        found = self.graph.node(
            "Conv",
            x,
            *(self.graph.weight(own[:kept]) for own in arrays),
            kernel_shape=[kernel, kernel],
            strides=[stride, stride],
            pads=[(kernel - 1) // 2] * 4,
        )
        for operator, bound in bounds.items():
            found = self.graph.node(operator, found, self.graph.array(bound[None, :, None, None]))
        return found

    def block(
        self,
        x: str,
        name: str,
        before: int,
        after: int,
        convolutions: int,
        *,
        halves: bool = False,
        is_bounded: bool = False,
    ) -> str:
        """``pix2face.networks.blocks.ResidualBlock``."""
        change = self.convolution(
            x,
            f"{name}.first",
            before,
            after,
            3,
            stride=2 if halves else 1,
            norm=f"{name}.first_norm",
            is_bounded=is_bounded,
        )
        if convolutions > 1:
            change = self.convolution(
                self.relu(change), f"{name}.second", after, after, 3, norm=f"{name}.second_norm", is_bounded=is_bounded
            )
        if halves:
            x = self.graph.node("AveragePool", x, kernel_shape=[2, 2], strides=[2, 2])
            x = self.convolution(x, f"{name}.shortcut", before, after, 1)
        return self.relu(self.add(change, x))

    def linear(self, x: str, name: str, before: int, after: int) -> str:
        """A matrix and a bias."""
        weight, bias = self._weights.take(f"{name}.weight", after, before), self._weights.take(f"{name}.bias", after)
        return self.graph.node("Gemm", x, self.graph.weight(weight), self.graph.weight(bias), transB=1)

    def relu(self, x: str) -> str:
        """ReLU."""
        return self.graph.node("Relu", x)

    def add(self, x: str, y: str) -> str:
        """A sum."""
        return self.graph.node("Add", x, y)

    def enlarged(self, x: str, factor: int, mode: str) -> str:
        """Planes at a larger size; the mode is that of ONNX, nearest or linear."""
        factors = self.graph.array(np.array([1, 1, factor, factor], np.float32))
        if mode == "nearest":
            return self.graph.node(
                "Resize", x, "", factors, mode=mode, coordinate_transformation_mode="asymmetric", nearest_mode="floor"
            )
        return self.graph.node("Resize", x, "", factors, mode=mode, coordinate_transformation_mode="half_pixel")

    def instance_norm(self, x: str, width: int) -> str:
        """Mean 0 and variance 1 for each plane of each picture."""
        ones, zeros = np.ones(width, np.float32), np.zeros(width, np.float32)
        return self.graph.node(
            "InstanceNormalization", x, self.graph.array(ones), self.graph.array(zeros), epsilon=VARIANCE_FLOOR
        )

    def pooled(self, x: str, side: int, places: int) -> str:
        """Means over the bins of torch's ``AdaptiveAvgPool2d``, flat."""
        bins = np.zeros((places, side), np.float32)
        for place, own in enumerate(bins):
            first, end = place * side // places, -(-(place + 1) * side // places)
            own[first:end] = 1 / (end - first)
        rows = self.graph.node("MatMul", x, self.graph.array(np.ascontiguousarray(bins.T)))
        return self.graph.node("Flatten", self.graph.node("MatMul", self.graph.array(bins), rows), axis=1)

    def reshaped(self, x: str, *shape: int) -> str:
        """A vector for each picture in another shape."""
        return self.graph.node("Reshape", x, self.graph.array(np.array([-1, *shape], np.int64)))
