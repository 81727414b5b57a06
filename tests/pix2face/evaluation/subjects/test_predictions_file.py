"""What other systems hand in: read in every layout, and refused in a line where it cannot be meant."""

import zipfile

import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.evaluation.subjects.predictions_file import Predictions, read_predictions, write_predictions

POINTS = np.random.default_rng(0).uniform(0, 200, (2, 68, 2))
NAMES = np.array(["a", "b"])


def write_csv(path, points, names=("a", "b"), axes="xy", heading=None):
    columns = heading or ["name", *(f"{axis}{index}" for index in range(68) for axis in axes)]
    rows = [[name, *map(repr, own.ravel().tolist())] for name, own in zip(names, points, strict=True)]
    path.write_text("\n".join(",".join(row) for row in [columns, *rows]) + "\n")
    return path


@pytest.mark.parametrize(("frame", "shift"), [("0-based", 0.5), ("1-based", -0.5), ("half-pixel", 0)])
def test_pixels_are_brought_to_the_projects_frame(tmp_path, frame, shift):
    np.savez(tmp_path / "p.npz", names=NAMES, landmarks=POINTS)
    write_csv(tmp_path / "p.csv", POINTS)
    for name in ("p.npz", "p.csv"):
        predicted = read_predictions(tmp_path / name, frame)
        assert predicted.names == ("a", "b")
        np.testing.assert_allclose(predicted.landmarks2d, POINTS + shift)
        assert predicted.landmarks3d is None


def test_a_third_coordinate_is_space_and_moves_no_pixel(tmp_path):
    points = np.dstack([POINTS, np.ones((2, 68))])
    np.savez(tmp_path / "p.npz", names=NAMES, landmarks=points.astype(np.float32))
    write_csv(tmp_path / "p.csv", points, axes="xyz")
    for name in ("p.npz", "p.csv"):
        predicted = read_predictions(tmp_path / name)
        np.testing.assert_allclose(predicted.landmarks2d, POINTS + 0.5, atol=1e-4)
        np.testing.assert_allclose(predicted.landmarks3d, points, atol=1e-4)


def test_space_and_pose_may_come_apart(tmp_path):
    space, pose = np.ones((2, 68, 3)), np.array([[1.0, 2, 3], [np.nan, 0, 0]])
    np.savez(tmp_path / "p.npz", names=NAMES, landmarks=POINTS, landmarks3d=space, pose_deg=pose)
    predicted = read_predictions(tmp_path / "p.npz")
    np.testing.assert_array_equal(predicted.landmarks3d, space)
    np.testing.assert_array_equal(predicted.pose_deg, pose)


def test_what_is_written_is_read_back(tmp_path):
    written = Predictions(source=tmp_path, names=("ibug/ä.jpg", "b"), landmarks2d=POINTS, pose_deg=np.zeros((2, 3)))
    write_predictions(tmp_path / "p.npz", written)
    read = read_predictions(tmp_path / "p.npz")
    assert read.names == written.names
    np.testing.assert_allclose(read.landmarks2d, POINTS)
    np.testing.assert_array_equal(read.pose_deg, written.pose_deg)


def test_an_empty_cell_is_a_face_that_was_not_found(tmp_path):
    path = write_csv(tmp_path / "p.csv", POINTS)
    heading, first, second = path.read_text().splitlines()
    path.write_text("\n".join([heading, "a" + "," * 136, second, ""]))
    predicted = read_predictions(path)
    assert np.isnan(predicted.landmarks2d[0]).all()
    assert np.isfinite(predicted.landmarks2d[1]).all()
    assert first.startswith("a,")


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"landmarks": POINTS}, "missing names"),
        ({"names": NAMES}, "missing landmarks"),
        ({"names": NAMES, "landmarks": POINTS[:1]}, r"shape \(2, 68, 2\) or \(2, 68, 3\), found shape \(1, 68, 2\)"),
        ({"names": NAMES, "landmarks": POINTS[:, :51]}, r"found shape \(2, 51, 2\)"),
        ({"names": NAMES, "landmarks": POINTS.astype(str)}, "as numbers"),
        ({"names": np.array(["a", "a"]), "landmarks": POINTS}, "each name once, found 'a' 2 times"),
        ({"names": np.array([1, 2]), "landmarks": POINTS}, "names as a list of texts"),
        ({"names": np.array([]), "landmarks": POINTS[:0]}, "names as a list of texts"),
        ({"names": NAMES, "landmarks": POINTS, "pose_deg": np.zeros((2, 2))}, "pose_deg"),
        ({"names": NAMES, "landmarks": POINTS, "landmarks3d": POINTS}, "landmarks3d"),
        ({"names": NAMES, "landmarks": POINTS * 1e300}, "up to ±1e.09, found"),
        ({"names": NAMES.astype(object), "landmarks": POINTS}, "cannot be read"),
    ],
)
def test_arrays_that_cannot_be_meant_are_refused(tmp_path, arrays, message):
    np.savez(tmp_path / "p.npz", **arrays)
    with pytest.raises(InputFileError, match=message) as caught:
        read_predictions(tmp_path / "p.npz")
    assert "p.npz" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "found nothing"),
        ("name,x,y\na,1,2\n", "expected the heading"),
        ("HEADING\na,1,2\n", "expected 137 columns in row 2, found 3"),
        ("HEADING\n" + "a" + ",left" * 136 + "\n", "expected numbers in row 2"),
        ("HEADING\n" + ("a" + ",1" * 136 + "\n") * 2, "each name once"),
        ("HEADING\n", "names as a list of texts"),
    ],
)
def test_tables_that_cannot_be_meant_are_refused(tmp_path, text, message):
    heading = ",".join(["name", *(f"{axis}{index}" for index in range(68) for axis in "xy")])
    (tmp_path / "p.csv").write_text(text.replace("HEADING", heading))
    with pytest.raises(InputFileError, match=message):
        read_predictions(tmp_path / "p.csv")


def test_other_files_are_refused(tmp_path):
    for name, content in (("p.npz", b"no zip"), ("p.csv", b"\xff\xfe\xfa"), ("p.txt", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputFileError, match=name):
            read_predictions(tmp_path / name)
    with pytest.raises(InputFileError, match=r"absent\.npz"):
        read_predictions(tmp_path / "absent.npz")


def test_a_declared_size_is_not_believed(tmp_path):
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 68, 2), }"
    with zipfile.ZipFile(tmp_path / "p.npz", "w") as archive:
        archive.writestr("names.npy", b"\x93NUMPY\x01\x00" + bytes([len(header), 0]) + header.encode())
        archive.writestr("landmarks.npy", b"\x93NUMPY\x01\x00" + bytes([len(header), 0]) + header.encode())
    with pytest.raises(InputFileError, match=r"at most .* possible"):
        read_predictions(tmp_path / "p.npz")
