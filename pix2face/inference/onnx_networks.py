"""The networks of ``pix2face.networks`` as graphs of ONNX, from the weights of a checkpoint."""

from collections.abc import Sequence
from itertools import pairwise

from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.onnx_graph import OnnxGraph
from pix2face.inference.onnx_layers import Layers
from pix2face.inference.weight_files import Weights
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

INPUT_NAME, OUTPUT_NAME, LANDMARKS_NAME, SEEN_NAME = "image", "maps", "landmarks", "seen"


def add_network(graphs: tuple[OnnxGraph, OnnxGraph], weights: Weights, header: CheckpointHeader, planes: int) -> None:
    """Adds the network of a checkpoint to graphs, from its input to its outputs.

    Args:
        graphs: For the part up to the landmarks, and for the rest; the same graph twice for the whole network, as which
            the paper's is always made.
        weights: Of the checkpoint. All but those of the correction itself are taken.
        header: Of the checkpoint.
        planes: Number of planes that are answered, the first ones.

    Raises:
        ValueError: An array is missing or has another shape.
    """
    first, second = graphs
    image = first.input(INPUT_NAME, ("batch", PLANES_IN, header.size_px, header.size_px))
    if header.architecture == "paper":
        maps, seen, landmarks = _paper(Layers(first, weights), image, header, planes), "", ""
    else:
        features, landmarks = _encoder(Layers(first, weights), image, header)
        if second is not first:
            features = [_handed_over(graphs, *own) for own in zip(features, _feature_shapes(header), strict=True)]
        maps, seen = _decoder(Layers(second, weights), features, header, planes)
    second.output(OUTPUT_NAME, maps, ("batch", planes, header.size_px, header.size_px))
    if seen:
        second.output(SEEN_NAME, seen, ("batch", "features"))
    if landmarks:
        first.output(LANDMARKS_NAME, landmarks, ("batch", header.n_landmarks, LANDMARK_NUMBERS))


def _encoder(layers: Layers, image: str, header: CheckpointHeader) -> tuple[list[str], str]:
    """The first half of ``pix2face.networks.residual.ResidualUNet``.

    Returns:
        The features that the decoder needs, with the shapes of ``_feature_shapes``; and landmarks, empty if there are
        none.
    """
    widths = header.widths
    x = layers.convolution(image, "stem", PLANES_IN, widths[0], 3, stride=2, norm="stem_norm")
    x, skips = layers.relu(x), []
    for level, (before, after) in enumerate(pairwise(widths)):
        skips.append(x)
        x = layers.block(x, f"encoder.{level}", before, after, ENCODER_CONVOLUTIONS[level], halves=True)
    for place in range(INNER_BLOCKS):
        x = layers.block(x, f"inner.{place}", widths[-1], widths[-1], 2, is_bounded=True)
    x = _outwards(layers, x, skips.pop(), 0, widths)
    return [*skips, x], _landmarks(layers, x, widths[-2], header) if header.n_landmarks else ""


def _feature_shapes(header: CheckpointHeader) -> list[tuple[int, int, int]]:
    """Planes and sides of the features between the halves of a residual network, from the outermost inwards."""
    sides = (header.size_px // 2 ** (level + 1) for level in range(len(header.widths) - 1))
    return [(width, side, side) for width, side in zip(header.widths, sides, strict=False)]


def _handed_over(graphs: tuple[OnnxGraph, OnnxGraph], features: str, shape: tuple[int, int, int]) -> str:
    """Features of the first graph as an input of the second."""
    first, second = graphs
    first.output(f"features_{features}", features, ("batch", *shape))
    return second.input(f"features_{features}", ("batch", *shape))


def _decoder(layers: Layers, features: Sequence[str], header: CheckpointHeader, planes: int) -> tuple[str, str]:
    """The second half: planes, and what the correction of fits goes by; empty if there is none."""
    widths, n_planes = header.widths, header.planes
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
    fine = layers.graph.node("DepthToSpace", fine, blocksize=2, mode="CRD")
    maps = layers.add(fine, layers.enlarged(coarse, 4, "linear"))
    return maps, _seen(layers, levels[: len(CORRECTION_WIDTHS)][::-1], header) if header.n_corrected else ""


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
    flat = layers.pooled(x, _feature_shapes(header)[-1][1], LANDMARK_PLACES)
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
    return layers.pooled(x, _feature_shapes(header)[-1][1], CORRECTION_PLACES)
