"""The networks of ``pix2face.networks`` as graphs of ONNX, from the weights of a checkpoint.

Norms are folded into the convolutions before them; the bounds of the innermost ones remain.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import final

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.onnx_graph import OnnxGraph
from pix2face.networks import LANDMARK_NUMBERS
from pix2face.networks.dimensions import (
    CENTRE_PLANES,
    CORRECTION_PLACES,
    CORRECTION_WIDTHS,
    DECODER_CONVOLUTIONS,
    ENCODER_CONVOLUTIONS,
    FARTHEST,
    INNER_BLOCKS,
    LANDMARK_FEATURES,
    LANDMARK_PLACES,
    LEAK,
    PLANES_IN,
    VARIANCE_FLOOR,
)

NORM_EPSILON = 1e-5  # of torch's batch norms


@final
class Weights:
    """The arrays of a checkpoint, each of which is taken once.

    Args:
        arrays: By the names that they have in torch.
    """

    def __init__(self, arrays: Mapping[str, ndarray]) -> None:
        self._left = dict(arrays)

    def take(self, name: str, *shape: int) -> Float32[ndarray, "..."]:
        """Returns an array as float32.

        Raises:
            ValueError: It is missing or of another shape.
        """
        found = self._left.pop(name, None)
        if found is None or found.shape != shape:
            raise ValueError(f"{name} should be {shape} and is {'missing' if found is None else found.shape}")
        return found.astype(np.float32)

    def take_norm(self, name: str, width: int) -> tuple[Float32[ndarray, " c"], Float32[ndarray, " c"]]:
        """Mean, and deviation with the epsilon that torch adds, of a batch norm."""
        self._left.pop(f"{name}.num_batches_tracked", None)
        mean, variance = (self.take(f"{name}.{part}", width) for part in ("running_mean", "running_var"))
        return mean, np.sqrt(variance + np.float32(NORM_EPSILON))

    def check_empty(self) -> None:
        """Checks that everything was taken.

        Raises:
            ValueError: Something is left.
        """
        for name in sorted(self._left):
            raise ValueError(f"{name} should be missing and is {self._left[name].shape}")


def face_network(
    graph: OnnxGraph, image: str, weights: Weights, header: CheckpointHeader, planes: int
) -> dict[str, str]:
    """The network of a checkpoint, whose weights are taken.

    Args:
        graph: To which it is added.
        image: Its input, ``b 3 s s`` in [-0.5, 0.5].
        weights: Of the checkpoint.
        header: Of the checkpoint.
        planes: Number of planes that are answered, the first ones.

    Returns:
        The names of its answers: "planes", ``b planes s s``; "landmarks", ``b n 3``, if it predicts them; and
        "seen", ``b k``, which the correction of fits goes by, if it has one.

    Raises:
        ValueError: An array is missing or has another shape.
    """
    if header.architecture == "paper":
        return {"planes": _paper(_Layers(graph, weights), image, header, planes)}
    features, landmarks = residual_encoder(graph, image, weights, header)
    return residual_decoder(graph, features, weights, header, planes) | landmarks


def residual_encoder(
    graph: OnnxGraph, image: str, weights: Weights, header: CheckpointHeader
) -> tuple[list[str], dict[str, str]]:
    """The first half of ``pix2face.networks.residual.ResidualUNet``, up to the landmarks.

    The arguments are those of ``face_network``.

    Returns:
        The features that the decoder needs, with the shapes of ``feature_shapes``; and "landmarks", if there are any.
    """
    layers, widths = _Layers(graph, weights), header.widths
    x = layers.convolution(image, "stem", PLANES_IN, widths[0], 3, stride=2, norm="stem_norm")
    x, skips = layers.relu(x), []
    for level, (before, after) in enumerate(pairwise(widths)):
        skips.append(x)
        x = layers.block(x, f"encoder.{level}", before, after, ENCODER_CONVOLUTIONS[level], halves=True)
    for place in range(INNER_BLOCKS):
        x = layers.block(x, f"inner.{place}", widths[-1], widths[-1], 2, is_bounded=True)
    x = _outwards(layers, x, skips.pop(), 0, widths)
    landmarks = {"landmarks": _landmarks(layers, x, widths[-2], header)} if header.n_landmarks else {}
    return [*skips, x], landmarks


def feature_shapes(header: CheckpointHeader) -> list[tuple[int, int, int]]:
    """Planes and sides of the features between the halves of a residual network, from the outermost inwards."""
    sides = (header.size_px // 2 ** (level + 1) for level in range(len(header.widths) - 1))
    return [(width, side, side) for width, side in zip(header.widths, sides, strict=False)]


def residual_decoder(
    graph: OnnxGraph, features: Sequence[str], weights: Weights, header: CheckpointHeader, planes: int
) -> dict[str, str]:
    """The second half of ``pix2face.networks.residual.ResidualUNet``, from the features that the first half found.

    The other arguments and the answers are those of ``face_network``, without landmarks.
    """
    layers, widths, n_planes = _Layers(graph, weights), header.widths, header.planes
    *skips, x = features
    coarse, levels = "", []
    for level, width in enumerate(widths[-2::-1]):
        if level:
            x = _outwards(layers, x, skips.pop(), level, widths)
        levels.append((x, width))
        if skips:
            answer = layers.convolution(x, f"coarse_planes.{level}", width, n_planes, 1, has_bias=True, kept=planes)
            coarse = layers.add(answer, layers.enlarged(coarse, 2, "linear")) if coarse else answer
    # Four pixels of each plane at a time.
    fine = layers.convolution(x, "planes", widths[0], 4 * n_planes, 3, has_bias=True, kept=4 * planes)
    fine = graph.node("DepthToSpace", fine, blocksize=2, mode="CRD")
    found = {"planes": layers.add(fine, layers.enlarged(coarse, 4, "linear"))}
    if header.n_corrected:
        found["seen"] = _seen(layers, levels[: len(CORRECTION_WIDTHS)][::-1], header.size_px)
    return found


def centre_network(graph: OnnxGraph, pictures: str, weights: Weights, widths: Sequence[int], neck: int) -> str:
    """The network that finds faces (``training.detection.centre_network``).

    Raises:
        ValueError: An array is missing or has another shape.
    """
    layers = _Layers(graph, weights)

    def layer(x: str, name: str, before: int, after: int, stride: int = 1) -> str:
        return layers.relu(layers.convolution(x, f"{name}.0", before, after, 3, stride=stride, norm=f"{name}.1"))

    def residual(x: str, name: str, width: int) -> str:
        inner = layers.convolution(x, f"{name}.inner.0", width, width, 3, norm=f"{name}.inner.1")
        change = layers.convolution(layers.relu(inner), f"{name}.inner.3", width, width, 3, norm=f"{name}.inner.4")
        return layers.relu(layers.add(x, change))

    def side(x: str, name: str, before: int) -> str:
        return layers.convolution(x, f"{name}.0", before, neck, 1, norm=f"{name}.1")

    at2, at4, at8, at16, at32 = widths
    quarter = layer(layer(pictures, "to4.0", PLANES_IN, at2, 2), "to4.1", at2, at4, 2)
    eighth = residual(layer(quarter, "to8.0", at4, at8, 2), "to8.1", at8)
    sixteenth = layer(eighth, "to16.0", at8, at16, 2)
    for name in ("to16.1", "to16.2"):
        sixteenth = residual(sixteenth, name, at16)
    coarse = side(residual(layer(sixteenth, "to32.0", at16, at32, 2), "to32.1", at32), "side32", at32)
    for name, x, width in (("16", sixteenth, at16), ("8", eighth, at8)):
        both = layers.relu(layers.add(side(x, f"side{name}", width), layers.enlarged(coarse, 2, "nearest")))
        coarse = layer(both, f"mixed{name}", neck, neck)
    return layers.convolution(coarse, "answer", neck, CENTRE_PLANES, 1, has_bias=True)


def _paper(layers: "_Layers", image: str, header: CheckpointHeader, planes: int) -> str:
    """``pix2face.networks.paper.UNet``."""
    graph, widths = layers.graph, header.widths
    x, skips = image, []
    for level, (before, after) in enumerate(pairwise((PLANES_IN, *widths))):
        x = graph.node("LeakyRelu", x, alpha=LEAK) if level else x
        x = layers.convolution(x, f"encoder.{level}", before, after, 4, stride=2, has_bias=True)
        if 0 < level < len(widths) - 1:
            x = layers.instance_norm(x, after)
        skips.append(x)
    skips.pop()
    outwards = (*widths[-2::-1], header.planes)
    inputs = (widths[-1], *(2 * width for width in widths[-2::-1]))
    for level, (before, after) in enumerate(zip(inputs, outwards, strict=True)):
        x = layers.enlarged(layers.relu(x), 2, "linear")
        kept = None if skips else planes
        x = layers.convolution(x, f"decoder.{level}", before, after, 3, has_bias=True, kept=kept)
        if skips:
            x = graph.node("Concat", layers.instance_norm(x, after), skips.pop(), axis=1)
    return x


def _outwards(layers: "_Layers", x: str, skip: str, level: int, widths: Sequence[int]) -> str:
    """A level of the decoder, counted from the innermost."""
    before, after = widths[-1 - level], widths[-2 - level]
    x = layers.add(layers.enlarged(layers.convolution(x, f"narrow.{level}", before, after, 1), 2, "nearest"), skip)
    n_convolutions = DECODER_CONVOLUTIONS[level]
    return layers.block(x, f"decoder.{level}", after, after, n_convolutions) if n_convolutions else x


def _landmarks(layers: "_Layers", x: str, width: int, header: CheckpointHeader) -> str:
    """``pix2face.networks.residual.LandmarkHead``."""
    flat = layers.pooled(x, header.size_px // 32, LANDMARK_PLACES)
    n_numbers = header.n_landmarks * LANDMARK_NUMBERS
    first = layers.linear(flat, "landmarks.first", width * LANDMARK_PLACES**2, LANDMARK_FEATURES)
    second = layers.linear(layers.relu(first), "landmarks.second", LANDMARK_FEATURES, n_numbers)
    return layers.reshaped(second, header.n_landmarks, LANDMARK_NUMBERS)


def _seen(layers: "_Layers", levels: Sequence[tuple[str, int]], size_px: int) -> str:
    """``pix2face.networks.correction.FitCorrection.seen``."""
    narrowed = [
        layers.convolution(
            x, f"correction.narrow.{place}.change", before, after, 1, norm=f"correction.narrow.{place}.change_norm"
        )
        for place, ((x, before), after) in enumerate(zip(levels, CORRECTION_WIDTHS, strict=True))
    ]
    x = layers.relu(narrowed[0])
    for place, (before, after) in enumerate(pairwise(CORRECTION_WIDTHS)):
        x = layers.block(x, f"correction.blocks.{place}", before, after, 2, halves=True)
        x = layers.relu(layers.add(x, narrowed[place + 1]))
    x = layers.block(x, "correction.last", CORRECTION_WIDTHS[-1], CORRECTION_WIDTHS[-1], 2)
    return layers.pooled(x, size_px // 32, CORRECTION_PLACES)


@final
class _Layers:
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
        """A convolution with the batch norm after it, if that has a name; ``kept`` are the first planes of the output.

        Raises:
            ValueError: An array is missing or has another shape.
        """
        weight = self._weights.take(f"{name}.weight", after, before, kernel, kernel)
        shift = self._weights.take(f"{name}.bias", after) if has_bias else None
        gain = None
        if norm is not None:
            mean, deviation = self._weights.take_norm(norm, after)
            gain, shift = (self._weights.take(f"{norm}.{part}", after) for part in ("weight", "bias"))
            weight = weight * (gain / deviation)[:, None, None, None]
            bias = shift - mean * gain / deviation
        else:
            bias = shift
        arrays = [weight] if bias is None else [weight, bias]
        found = self.graph.node(
            "Conv",
            x,
            *(self.graph.weight(own[:kept]) for own in arrays),
            kernel_shape=[kernel, kernel],
            strides=[stride, stride],
            pads=[(kernel - 1) // 2] * 4,
        )
        if not is_bounded:
            return found
        assert gain is not None
        assert shift is not None
        farthest = FARTHEST * np.abs(gain)
        for operator, bound in (("Max", shift - farthest), ("Min", shift + farthest)):
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
