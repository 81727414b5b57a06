"""Signatures are checked under pytest, and the checks can fail."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest
from jaxtyping import Float, TypeCheckError
from numpy import ndarray

from pix2face.geometry.crops import FaceBox
from pix2face.geometry.rigid_alignment import fit_rigid
from tests.type_checker import check, jaxtyped

if TYPE_CHECKING:
    from tests.nowhere import Unknown

hooked = jaxtyped(typechecker=check)


@hooked
def moved(points: Float[ndarray, "n 2"], by: Float[ndarray, "2"], *, times: float = 1.0) -> Float[ndarray, "n 2"]:
    return (points + times * by)[: None if times else 1]


@hooked
def numbers(end: int) -> Iterator[int]:
    yield from range(end)


@hooked
def known_elsewhere(value: "Unknown") -> "Unknown":
    return value


@hooked
class Doubling:
    @hooked
    def __call__(self, points: Float[ndarray, " n"]) -> Float[ndarray, " n"]:
        return np.concatenate([points, points])


@hooked
@dataclass
class Pair:
    first: Float[ndarray, " n"]
    second: Float[ndarray, " n"]


def test_what_fits_is_let_through() -> None:
    assert moved(np.zeros((3, 2)), np.ones(2), times=2).tolist() == [[2, 2]] * 3
    assert list(numbers(3)) == [0, 1, 2]
    assert known_elsewhere("anything") == "anything"
    assert len(Pair(np.zeros(3), np.zeros(3)).first) == 3
    assert moved(moved(np.zeros((5, 2)), np.ones(2)), np.ones(2)).shape == (5, 2)


@pytest.mark.parametrize(
    "call",
    [
        lambda: moved([[0.0, 0.0]], np.ones(2)),
        lambda: moved(np.zeros((3, 2), dtype=int), np.ones(2)),
        lambda: moved(np.zeros((3, 3)), np.ones(2)),
        lambda: moved(np.zeros((3, 2)), np.ones(2), times="2"),
        lambda: moved(np.zeros((3, 2)), np.ones(2), times=0),  # it returns one point, not three
        lambda: Doubling()(np.zeros(3)),
        lambda: Pair(np.zeros(3), np.zeros(4)),
        lambda: numbers("3"),
    ],
)
def test_what_does_not_fit_is_an_error(call) -> None:
    with pytest.raises(TypeCheckError):
        call()


def test_the_project_is_checked() -> None:
    with pytest.raises(TypeCheckError):
        FaceBox("0", 0, 1, 1)
    with pytest.raises(TypeCheckError):
        fit_rigid(np.zeros((3, 3)), np.zeros((4, 3)))
