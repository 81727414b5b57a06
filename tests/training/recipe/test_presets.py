from dataclasses import replace

import pytest

from pix2face.errors import UsageError
from pix2face.geometry.jitter import JitterRange
from training.recipe.presets import PRESETS
from training.recipe.recipe import LossWeights


def test_paper_is_the_papers():
    paper = PRESETS["paper"]
    assert (paper.size_px, paper.filters, paper.batch_size) == (256, 64, 4)
    assert (paper.epochs, paper.epoch_size, paper.learning_rate) == (60, 100_000, 1e-3)
    assert (paper.architecture, paper.planes, paper.schedule) == ("paper", 6, "paper")
    assert paper.widths == (64, 128, 256, 512, 512, 512, 512, 512)
    assert (paper.weights.pncc, paper.weights.offset, paper.loss_over) == (1, 1, "all")
    assert (paper.parts, paper.clip, paper.ema, paper.warm_up) == (1, 0, 0, 0)
    assert paper.cropping == "full"
    assert paper.jitter == JitterRange(scale=(1.0, 1.8), shift=0.25, rotation_deg=20, gamma=(0.8, 1.2), gain=0.8)


@pytest.mark.parametrize("name", list(PRESETS))
def test_presets_make_sense(name):
    PRESETS[name].check()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size_px": 100}, r"--size-px: expected a power of two.*100"),
        ({"epochs": 0}, "--epochs: expected a finite number above 0, found 0"),
        ({"epoch_size": -1}, "--epoch-size"),
        ({"batch_size": 0}, "--batch-size"),
        ({"filters": 0}, "--filters"),
        ({"learning_rate": float("nan")}, "--learning-rate: expected a finite number above 0, found nan"),
        ({"filters": 129}, "--filters: expected at most 128, so that no level has more than 1024, found 129"),
        ({"size_px": 2048}, "--size-px: expected at most 1024, found 2048"),
        ({"parts": 3}, "--parts: expected a divisor of 8, the batch's size, found 3"),
        ({"parts": 0}, "--parts: expected a finite number above 0, found 0"),
        ({"planes": 5}, "--planes: expected at least 6, found 5"),
        ({"planes": 10}, "--planes: expected at most 9, found 10"),
        ({"clip": -1.0}, "--clip: expected a finite number of at least 0, found -1.0"),
        ({"warm_up": -1}, "--warm-up: expected a finite number of at least 0, found -1"),
        ({"ema": 1.0}, "--ema: expected 0 or more and less than 1, found 1.0"),
        ({"ema": float("nan")}, "--ema: expected 0 or more and less than 1, found nan"),
        ({"weights": LossWeights(pncc=-1)}, "--weight-pncc: expected 0 or more, found -1"),
        ({"weights": LossWeights(pncc=0, offset=0)}, "--weight-pncc, --weight-offset: expected one above 0"),
        ({"loss_over": "mask"}, "--loss-over mask: expected --planes 7 or 8, found 6"),
        ({"architecture": "residual", "size_px": 96}, "--size-px: expected a multiple of 64 .* found 96"),
        ({"seed": -1}, "--seed: expected 0 to 9223372036854775807, found -1"),
        ({"seed": 2**63}, "--seed: expected 0 to 9223372036854775807, found 9223372036854775808"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(change, message):
    with pytest.raises(UsageError, match=message):
        replace(PRESETS["tiny"], **change).check()
