"""The named recipes, and why each differs from the paper (measurements: docs/explanation/training.md).

``paper`` is the paper's: 256 px, 64 filters, batches of 4, 60 epochs of 100,000 pictures. It asks for a GPU and days.

``tiny`` shows on two CPU cores, in about two minutes, that everything works. It is the same architecture, loss,
optimiser, jitter and schedule. It differs in size (64 px, so two levels less, and 16 filters), in the number of
pictures, in larger batches (fewer, cheaper steps) and in bfloat16 arithmetic. In equal time 64 px come out well ahead
of 128 px, because so short a training is limited by the number of pictures seen (docs/explanation/training.md).

``cpu`` trains a network worth having on two CPU cores, in half an hour or, with more ``--samples``, in hours; ``gpu`` a
sharper one on a GPU. Both take the residual network, which also answers where the face is and where it is seen.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Literal

from pix2face.geometry.jitter import JitterRange
from training.recipe.recipe import LossWeights, Recipe

PresetName = Literal["paper", "tiny", "cpu", "gpu"]

# With equal weights offsets, whose scale is small beside PNCC's, stay at zero for 84,000 samples; from 4 on they move.
# Masks are near their best within minutes, and need little.
_WITH_MASKS = LossWeights(pncc=1.0, offset=4.0, mask=0.2, seen=0.2)
# Faces in photographs have more contrast than in renders (docs/explanation/picture_defects.md), and a
# look-up costs nothing.
_PHOTOGRAPHS = JitterRange(gamma=(0.65, 1.5), gain=0.75, contrast=(0.75, 1.8), mirror=True)

_CPU = Recipe(
    architecture="residual",
    size_px=128,
    filters=32,
    planes=8,
    batch_size=24,
    epochs=30,
    epoch_size=9_600,
    learning_rate=1e-3,
    schedule="cosine",
    warm_up=9_600,
    precision="bfloat16",
    weights=_WITH_MASKS,
    clip=1.0,
    ema=0.999,
    norm_batches=100,
    jitter=_PHOTOGRAPHS,
)

PRESETS: Mapping[PresetName, Recipe] = MappingProxyType(
    {
        # Source: Crispell and Bazik 2017, Sec. 3.2.
        "paper": Recipe(
            size_px=256,
            filters=64,
            batch_size=4,
            epochs=60,
            epoch_size=100_000,
            learning_rate=1e-3,
            precision="bfloat16",
        ),
        "tiny": Recipe(
            size_px=64,
            filters=16,
            batch_size=8,
            epochs=6,
            epoch_size=3_000,
            learning_rate=1e-3,
            precision="bfloat16",
        ),
        "cpu": _CPU,
        "gpu": replace(_CPU, size_px=256, batch_size=48, epochs=42, epoch_size=48_000, warm_up=48_000),
    }
)
