import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.shards.sample import JITTER_OF, PICTURE, PictureKind
from training.data.persons import PersonGroups

A, B, C = (np.array([value, 0.5], dtype=np.float32) for value in (1, 2, 3))


def hashes(*samples) -> list[int]:
    groups = PersonGroups()
    for sample_id, identity, attributes in samples:
        groups.add(sample_id, identity, attributes)
    return groups.hashes().tolist()


def test_the_same_coefficients_are_the_same_person():
    first, second, third = hashes(("a", A, {}), ("b", B, {}), ("c", A, {}))
    assert first == third != second


def test_variants_of_a_face_are_one_person_mirrored_or_not():
    one, mirrored, other = hashes(
        ("f/jitter-0", A, {JITTER_OF: "f"}),
        ("f/jitter-1", B, {JITTER_OF: "f"}),
        ("g/jitter-0", C, {JITTER_OF: "g"}),
    )
    assert one == mirrored != other


@pytest.mark.parametrize(
    ("first", "second", "is_same"),
    [
        ("AFW/AFW_134212_1_0", "AFW_Flip/AFW_134212_1_5", True),
        ("AFW/AFW_134212_1_0", "AFW/AFW_134212_2_0", False),
        ("LFPW/LFPW_image_train_0001_3", "LFPW/LFPW_image_train_0001_12", True),
        ("LFPW/LFPW_image_train_0001_3", "LFPW/LFPW_image_train_0002_3", False),
        ("indoor_001", "indoor_002", False),
        ("image00002", "image00004", False),
    ],
)
def test_the_turned_copies_of_a_photograph_are_one_person(first, second, is_same):
    photograph = {PICTURE: PictureKind.PHOTOGRAPH}
    one, other = hashes((first, A, photograph), (second, B, photograph))
    assert (one == other) == is_same


def test_samples_are_joined_through_others():
    found = hashes(("f/jitter-0", A, {JITTER_OF: "f"}), ("x", C, {}), ("f/jitter-1", B, {JITTER_OF: "f"}), ("y", B, {}))
    assert found[0] == found[2] == found[3] != found[1]


def test_a_model_without_identity_tells_nobody_apart_by_it():
    empty = np.zeros(0, dtype=np.float32)
    assert len(set(hashes(("a", empty, {}), ("b", empty, {})))) == 2


@given(st.permutations(range(6)))
def test_the_order_of_samples_changes_nothing(order):
    samples = [
        ("f/jitter-0", A, {JITTER_OF: "f"}),
        ("f/jitter-1", B, {JITTER_OF: "f"}),
        ("x", C, {}),
        ("y", B, {}),
        ("AFW/AFW_1_1_0", C, {PICTURE: PictureKind.PHOTOGRAPH}),
        ("AFW/AFW_1_1_1", A * 7, {PICTURE: PictureKind.PHOTOGRAPH}),
    ]
    found = hashes(*(samples[place] for place in order))
    assert dict(zip(order, found, strict=True)) == dict(enumerate(hashes(*samples)))
