"""Landmark tables are consistent, and .pts files are read exactly or refused clearly."""

from pathlib import Path

import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.geometry.landmarks import (
    IBUG68_GROUPS,
    IBUG68_PARTS,
    INNER51,
    LEFT_EYE,
    MIRROR_IBUG68,
    N_IBUG68,
    OUTER_EYE_CORNERS,
    RIGHT_EYE,
    WFLW98_OF_IBUG68,
    read_pts,
)
from tests.synthetic_models import small_head_model


def write_pts(path: Path, n: int = 68, declared: str | None = None, end: str = "}") -> Path:
    lines = "\n".join(f"{i}.25 {i + 100}.5" for i in range(n))
    path.write_text(f"version: 1\nn_points:  {declared or n}\n{{\n{lines}\n{end}")
    return path


@pytest.mark.parametrize("groups", [IBUG68_GROUPS, IBUG68_PARTS])
def test_groups_cover_every_point_once(groups):
    assert sorted(index for group in groups.values() for index in group) == list(range(N_IBUG68))


def test_mirror_twice_is_identity_and_keeps_parts():
    mirror = np.array(MIRROR_IBUG68)
    np.testing.assert_array_equal(mirror[mirror], np.arange(N_IBUG68))
    for part in IBUG68_PARTS.values():
        assert {MIRROR_IBUG68[index] for index in part} == set(part)
    assert {MIRROR_IBUG68[index] for index in RIGHT_EYE} == set(LEFT_EYE)
    assert MIRROR_IBUG68[OUTER_EYE_CORNERS[0]] == OUTER_EYE_CORNERS[1]
    assert [i for i in range(68) if MIRROR_IBUG68[i] == i] == [8, 27, 28, 29, 30, 33, 51, 57, 62, 66]


def test_mirror_agrees_with_the_symmetry_of_a_model():
    model = small_head_model()
    vertices = model.landmarks["ibug68"]
    np.testing.assert_array_equal(model.symmetry[vertices], vertices[list(MIRROR_IBUG68)])


def test_inner_points_leave_out_the_jaw():
    assert len(INNER51) == 51
    assert not set(INNER51) & set(IBUG68_PARTS["jaw"])


def test_read_pts_turns_one_based_pixels_into_centres_at_a_half(tmp_path):
    points = read_pts(write_pts(tmp_path / "a.pts"))
    np.testing.assert_allclose(points[[0, 3]], [[-0.25, 100.0], [2.75, 103.0]])


def test_the_98_points_of_wflw_hold_the_68(tmp_path):
    points = read_pts(write_pts(tmp_path / "a.pts", 98))
    numbers = points[:, 0] - 0.25 + 0.5
    np.testing.assert_array_equal(numbers, WFLW98_OF_IBUG68)
    assert len(set(WFLW98_OF_IBUG68)) == N_IBUG68
    # WFLW's own table of mirrored points (jaw, brows, nose, eyes, lips) and ours mean the same faces.
    mirror = [
        *range(32, -1, -1),
        *(46, 45, 44, 43, 42, 50, 49, 48, 47, 37, 36, 35, 34, 33, 41, 40, 39, 38),
        *(51, 52, 53, 54, 59, 58, 57, 56, 55),
        *(72, 71, 70, 69, 68, 75, 74, 73, 64, 63, 62, 61, 60, 67, 66, 65),
        *(82, 81, 80, 79, 78, 77, 76, 87, 86, 85, 84, 83, 92, 91, 90, 89, 88, 95, 94, 93),
    ]
    assert [mirror[point] for point in WFLW98_OF_IBUG68] == [WFLW98_OF_IBUG68[i] for i in MIRROR_IBUG68]
    with pytest.raises(InputFileError, match="expected 68 points"):
        read_pts(write_pts(tmp_path / "b.pts", 97))
    with pytest.raises(InputFileError, match="expected 51 points"):
        read_pts(tmp_path / "a.pts", 51)


def test_read_pts_reads_the_photographs_annotations(shared_dir):
    paths = sorted((shared_dir / "data" / "300w").rglob("*.pts"))
    assert paths
    for path in paths:
        first = path.read_text().split("{")[1].split()[:2]
        np.testing.assert_array_equal(read_pts(path)[0], np.array(first, dtype=float) - 0.5)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "expected 'version'"),
        (b"\x89PNG\r\n\x1a\n\xff", "binary"),
        (b"version: 1\nn_points: 68\n{\n1 2\n3 4\n", "cut off"),
        (b"version: 1\nn_points: 68\n{\n1 2\n3 4\n}", "68 points in .* found n_points: 68 and 2 points"),
        (b"version: 1\nn_points: 2\n{\n1 2\n3 4\n}", "found n_points: 2"),
        (b"version: 1\nn_points: 68\n{\n" + b"1 x\n" * 68 + b"}", "expected numbers"),
        (b"version: 1\nn_points: 68\n{\n" + b"1 2\n" * 67 + b"1}", "found n_points: 68 and 67.5 points"),
    ],
)
def test_damaged_annotations_are_refused_by_name(tmp_path, content, message):
    path = tmp_path / "damaged.pts"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=message) as caught:
        read_pts(path)
    assert "damaged.pts" in str(caught.value)


@pytest.mark.parametrize("marker", ["-1 -1", "-1.000 -1.000", "0 0", "nan nan", "12 nan", "-99 -99", "inf 3"])
def test_marks_of_missing_points_are_read_as_missing(tmp_path, marker):
    path = write_pts(tmp_path / "a.pts")
    lines = path.read_text().splitlines()
    lines[3 + 7] = marker
    path.write_text("\n".join(lines))
    points = read_pts(path)
    assert np.flatnonzero(np.isnan(points).any(axis=1)).tolist() == [7]
    assert np.isnan(points[7]).all()
