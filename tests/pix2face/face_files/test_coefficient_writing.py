"""The streaming writer: the same table as the one written at once, in bounded memory."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pix2face.face_files.coefficient_writing import FACES_AT_ONCE, CoefficientWriter, TableHeader
from pix2face.face_files.coefficients import Face, FaceCoefficients, load_coefficients, save_coefficients
from pix2face.geometry.camera import Camera
from tests.full_disk import FULL, files_of_at_most

HEADER = TableHeader(model_name="small", model_sha256="f" * 64, n_identity=5, n_expression=3, licence="ours")


def make_face(index: int, folder: Path, **changes: object) -> Face:
    rng = np.random.default_rng(index)
    face = Face(
        sample_id=f"face/{index}",
        identity=rng.normal(size=5),
        expression=rng.normal(size=3),
        camera=Camera(rng.normal(size=(4, 4))),
        height_px=100 + index,
        width_px=200,
        image_path=folder / f"{index}.jpg" if index % 2 else None,
        attributes={"geometry": "drawn", "number": index},
    )
    return replace(face, **changes)


def write(path: Path, faces: list[Face], header: TableHeader = HEADER) -> FaceCoefficients:
    with CoefficientWriter(path, header) as writer:
        for face in faces:
            writer.add(face)
    return load_coefficients(path)


@pytest.mark.parametrize("n", [0, 1, FACES_AT_ONCE, FACES_AT_ONCE + 3])
def test_every_face_comes_back(tmp_path: Path, n: int) -> None:
    faces = [make_face(index, tmp_path / "pictures") for index in range(n)]
    table = write(tmp_path / "faces.h5", faces)
    assert len(table) == n
    assert table.licence == "ours"
    for index in {0, n // 2, n - 1} if n else ():
        found, expected = table.face(index, tmp_path), faces[index]
        assert found.sample_id == expected.sample_id
        np.testing.assert_array_equal(found.identity, expected.identity.astype(np.float32))
        np.testing.assert_array_equal(found.expression, expected.expression.astype(np.float32))
        np.testing.assert_array_equal(found.camera.matrix, expected.camera.matrix)
        assert (found.height_px, found.width_px) == (expected.height_px, expected.width_px)
        assert found.image_path == expected.image_path
        assert found.attributes == expected.attributes
        assert found.lighting is None


def test_what_is_streamed_equals_what_is_saved_whole(tmp_path: Path) -> None:
    streamed = write(tmp_path / "streamed.h5", [make_face(index, tmp_path) for index in range(7)])
    save_coefficients(streamed, tmp_path / "whole.h5")
    whole = load_coefficients(tmp_path / "whole.h5")
    for name in ("identity", "expression", "cameras", "sizes_px"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(streamed, name), strict=True)
    for name in ("sample_ids", "image_paths", "attributes", "licence", "model_name", "rejected"):
        assert getattr(whole, name) == getattr(streamed, name)


def test_photographs_are_found_from_the_table_wherever_both_lie(tmp_path: Path) -> None:
    pictures = tmp_path / "data" / "pictures"
    table = write(tmp_path / "tables" / "faces.h5", [make_face(1, pictures)])
    assert table.image_paths == ("../data/pictures/1.jpg",)
    found = table.face(0, tmp_path / "tables").image_path
    assert found is not None
    assert found.resolve() == (pictures / "1.jpg").resolve()


def test_lighting_is_kept_where_it_is_known(tmp_path: Path) -> None:
    lighting = np.arange(4.0)
    faces = [make_face(0, tmp_path, lighting=lighting), make_face(1, tmp_path)]
    table = write(tmp_path / "faces.h5", faces, replace(HEADER, n_lighting=4))
    np.testing.assert_array_equal(table.face(0, tmp_path).lighting, lighting)
    assert table.face(1, tmp_path).lighting is None


def test_a_model_without_expressions_has_an_empty_column(tmp_path: Path) -> None:
    faces = [make_face(index, tmp_path, expression=np.zeros(0)) for index in range(3)]
    assert write(tmp_path / "faces.h5", faces, replace(HEADER, n_expression=0)).expression.shape == (3, 0)


def test_rejected_faces_are_listed(tmp_path: Path) -> None:
    with CoefficientWriter(tmp_path / "faces.h5", HEADER) as writer:
        for index in range(300):
            writer.reject(f"bad/{index}", "no picture")
    assert load_coefficients(tmp_path / "faces.h5").rejected == tuple((f"bad/{i}", "no picture") for i in range(300))


def test_an_error_leaves_the_old_table_and_no_temporary_file(tmp_path: Path) -> None:
    path = tmp_path / "faces.h5"
    write(path, [make_face(0, tmp_path)])
    before = path.read_bytes()
    with pytest.raises(TypeError, match="broadcast"):
        write(path, [make_face(1, tmp_path, identity=np.zeros(6))])
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["faces.h5"]


def test_a_full_disk_is_noticed_before_the_last_face_and_leaves_no_file(tmp_path: Path) -> None:
    path, added = tmp_path / "faces.h5", list[int]()

    def fill() -> None:
        with CoefficientWriter(path, HEADER) as writer:
            for index in range(3 * FACES_AT_ONCE):
                writer.add(make_face(index, tmp_path))
                added.append(index)

    with files_of_at_most(5000), pytest.raises(OSError, match=rf"{FULL}: '\S*/faces\.h5'"):
        fill()
    assert len(added) < 3 * FACES_AT_ONCE - 1
    assert list(tmp_path.iterdir()) == []


def test_memory_does_not_grow_with_the_number_of_faces(tmp_path: Path) -> None:
    header = replace(HEADER, n_identity=199, n_expression=29)
    face = make_face(0, tmp_path, identity=np.zeros(199), expression=np.zeros(29))
    peaks = []
    for n in (FACES_AT_ONCE, 3 * FACES_AT_ONCE):
        tracemalloc.start()
        with CoefficientWriter(tmp_path / "faces.h5", header) as writer:
            for index in range(n):
                writer.add(replace(face, sample_id=str(index)))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0] < 60e6
