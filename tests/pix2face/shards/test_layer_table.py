"""The table of layers, how they are chosen, and their steps."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.errors import InputFileError, UsageError
from pix2face.shards.layers import DEFAULT_LAYERS, LAYER_NAMES, LAYERS, Layer, from_stored, parse_layers, to_stored

ROUNDED = [layer for layer in LAYERS.values() if layer.steps_per_unit > 1]


def test_a_choice_is_put_in_one_order_and_each_name_taken_once() -> None:
    assert parse_layers("mask, image,pncc,mask,") == ("image", "pncc", "mask")
    assert parse_layers(",".join(reversed(LAYER_NAMES))) == LAYER_NAMES
    assert parse_layers(" all ") == LAYER_NAMES
    assert set(DEFAULT_LAYERS) < set(LAYER_NAMES)


@pytest.mark.parametrize(
    ("text", "found"),
    [("image,pnc", "'pnc'"), ("", "none"), (" , ", "none"), ("PNCC", "'PNCC'"), ("all,mask", "'all'")],
)
def test_an_unknown_layer_is_named_with_those_that_there_are(text: str, found: str) -> None:
    message = f"expected layers among {','.join(LAYER_NAMES)}, or all, found {found}"
    with pytest.raises(UsageError, match=re.escape(message)):
        parse_layers(text)


@given(st.sampled_from(ROUNDED), st.integers(0, 99))
def test_rounding_is_at_most_half_a_step_off(layer: Layer, seed: int) -> None:
    limit = min(layer.limit, 1e4)
    lowest = -limit if np.iinfo(layer.stored).min else 0.0
    values = np.random.default_rng(seed).uniform(lowest, limit, layer.shape(6, 5)).astype(np.float32)
    steps = to_stored(layer, values)
    assert steps.dtype == layer.stored
    back = from_stored(layer, steps)
    assert back.dtype == np.float32
    half_a_step = 0.5 / layer.steps_per_unit
    assert np.abs(back.astype(np.float64) - values).max() <= half_a_step + np.spacing(np.float32(limit))
    np.testing.assert_array_equal(to_stored(layer, back), steps)


def test_maps_are_within_a_hundredth_of_a_millimetre() -> None:
    for name in ("pncc", "offset"):
        assert 0.5 / LAYERS[name].steps_per_unit < 0.01


@pytest.mark.parametrize("layer", list(LAYERS.values()), ids=list(LAYERS))
def test_steps_stay_as_they_are(layer: Layer) -> None:
    steps = np.arange(24, dtype=layer.stored).reshape(layer.shape(24 // layer.n_channels, 1))
    np.testing.assert_array_equal(to_stored(layer, steps), steps, strict=True)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e9])
@pytest.mark.parametrize("layer", ROUNDED, ids=[layer.name for layer in ROUNDED])
def test_values_that_do_not_fit_are_refused(layer: Layer, value: float) -> None:
    values = np.zeros(layer.shape(3, 3), np.float32)
    values[1, 1] = value
    with pytest.raises(InputFileError, match=rf"expected {layer.name} within ±"):
        to_stored(layer, values)


def test_a_mask_and_regions_are_stored_as_they_are() -> None:
    mask = np.array([[True, False]])
    assert to_stored(LAYERS["mask"], mask).tolist() == [[1, 0]]
    assert from_stored(LAYERS["mask"], to_stored(LAYERS["mask"], mask)).dtype == bool
    regions = np.array([[0, 7]], np.uint8)
    assert from_stored(LAYERS["regions"], to_stored(LAYERS["regions"], regions)).tolist() == [[0, 7]]
