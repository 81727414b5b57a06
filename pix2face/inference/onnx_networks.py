"""The networks of ``pix2face.networks`` as graphs of ONNX, from the weights of a checkpoint."""

from collections.abc import Sequence
from itertools import pairwise

from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.onnx_graph import OnnxGraph
from pix2face.inference.onnx_layers import Layers, Weights
from pix2face.networks import LANDMARK_NUMBERS
from pix2face.networks.dimensions import (
    CORRECTION_PLACES,
    CORRECTION_WIDTHS,
    DECODER_CONVOLUTIONS,
    ENCODER_CONVOLUTIONS,
    INNER_BLOCKS,
    LANDMARK_FEATURES,
    LANDMARK_PLACES,
    LEAK,
    PLANES_IN,
)


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
        return {"planes": _paper(Layers(graph, weights), image, header, planes)}
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
    layers, widths = Layers(graph, weights), header.widths
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
    layers, widths, n_planes = Layers(graph, weights), header.widths, header.planes
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
        found["seen"] = _seen(layers, levels[: len(CORRECTION_WIDTHS)][::-1], header)
    return found


def _paper(layers: Layers, image: str, header: CheckpointHeader, planes: int) -> str:
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


def _outwards(layers: Layers, x: str, skip: str, level: int, widths: Sequence[int]) -> str:
    """A level of the decoder, counted from the innermost."""
    before, after = widths[-1 - level], widths[-2 - level]
    x = layers.add(layers.enlarged(layers.convolution(x, f"narrow.{level}", before, after, 1), 2, "nearest"), skip)
    n_convolutions = DECODER_CONVOLUTIONS[level]
    return layers.block(x, f"decoder.{level}", after, after, n_convolutions) if n_convolutions else x


def _landmarks(layers: Layers, x: str, width: int, header: CheckpointHeader) -> str:
    """``pix2face.networks.residual.LandmarkHead``."""
    flat = layers.pooled(x, feature_shapes(header)[-1][1], LANDMARK_PLACES)
    n_numbers = header.n_landmarks * LANDMARK_NUMBERS
    first = layers.linear(flat, "landmarks.first", width * LANDMARK_PLACES**2, LANDMARK_FEATURES)
    second = layers.linear(layers.relu(first), "landmarks.second", LANDMARK_FEATURES, n_numbers)
    return layers.reshaped(second, header.n_landmarks, LANDMARK_NUMBERS)


def _seen(layers: Layers, levels: Sequence[tuple[str, int]], header: CheckpointHeader) -> str:
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
    return layers.pooled(x, feature_shapes(header)[-1][1], CORRECTION_PLACES)
