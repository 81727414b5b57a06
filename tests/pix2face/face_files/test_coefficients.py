"""The table of coefficients: what goes in comes out, and damage is noticed."""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from datagen.faces.sources import TableSource, open_source
from pix2face.errors import InputFileError, ModelMismatchError
from pix2face.face_files.coefficients import (
    FaceCoefficients,
    configuration_to_json,
    load_coefficients,
    save_coefficients,
)
from pix2face.files.text_columns import json_lines
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
ARRAYS = ("identity", "expression", "cameras", "sizes_px")


def make_table(n: int = 4, seed: int = 0, **changes: object) -> FaceCoefficients:
    rng = np.random.default_rng(seed)
    table = FaceCoefficients(
        model_name=MODEL.name,
        model_sha256=MODEL.sha256,
        sample_ids=tuple(f"face/{index}" for index in range(n)),
        identity=rng.normal(size=(n, MODEL.n_identity)).astype(np.float32),
        expression=rng.normal(size=(n, MODEL.n_expression)).astype(np.float32),
        cameras=rng.normal(size=(n, 4, 4)),
        sizes_px=rng.integers(1, 500, size=(n, 2)).astype(np.int32),
        image_paths=tuple("" if index % 2 else f"pictures/{index}.jpg" for index in range(n)),
        configuration='{"seed": 0}',
    )
    return replace(table, **changes)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "faces.h5"
    save_coefficients(make_table(), path)
    return path


@settings(max_examples=20)
@given(n=st.integers(0, 6), seed=st.integers(0, 2**32 - 1), name=st.text(max_size=20))
def test_what_is_written_is_read_back(tmp_path_factory: pytest.TempPathFactory, n: int, seed: int, name: str) -> None:
    path = tmp_path_factory.mktemp("tables") / "new folder" / "faces.h5"
    expected = make_table(n, seed, sample_ids=tuple(f"{index}{name}" for index in range(n)))
    save_coefficients(expected, path)
    found = load_coefficients(path)
    for array in ARRAYS:
        np.testing.assert_array_equal(getattr(found, array), getattr(expected, array), strict=True)
    for field in ("model_name", "model_sha256", "sample_ids", "image_paths", "configuration"):
        assert getattr(found, field) == getattr(expected, field)
    assert len(found) == n
    assert [entry.name for entry in path.parent.iterdir()] == ["faces.h5"]  # no temporary file stays


def test_the_same_table_gives_the_same_bytes(path: Path, tmp_path: Path) -> None:
    save_coefficients(make_table(), tmp_path / "again.h5")
    assert (tmp_path / "again.h5").read_bytes() == path.read_bytes()


def test_an_error_leaves_the_old_table_and_no_temporary_file(path: Path) -> None:
    before = path.read_bytes()
    with pytest.raises(ValueError, match="Expecting value"):
        save_coefficients(make_table(attributes=("{}", "{}", "{}", "no JSON")), path)
    assert path.read_bytes() == before
    assert [entry.name for entry in path.parent.iterdir()] == ["faces.h5"]


def test_a_row_is_a_face(path: Path) -> None:
    table = make_table()
    faces = [load_coefficients(path).face(index, path.parent) for index in range(2)]
    for index, face in enumerate(faces):
        assert face.sample_id == f"face/{index}"
        np.testing.assert_array_equal(face.identity, table.identity[index])
        np.testing.assert_array_equal(face.expression, table.expression[index])
        np.testing.assert_array_equal(face.camera.matrix, table.cameras[index])
        assert (face.height_px, face.width_px) == tuple(table.sizes_px[index])
    assert faces[0].image_path == path.parent / "pictures" / "0.jpg"
    assert faces[1].image_path is None  # a picture is to be rendered


def test_the_configuration_is_json_in_one_order() -> None:
    assert configuration_to_json({"b": Path("x"), "a": 1}) == configuration_to_json({"a": 1, "b": Path("x")})
    assert json.loads(configuration_to_json({"out": Path("x"), "n": 3})) == {"out": "x", "n": 3}


def test_repeated_ids_are_counted(tmp_path: Path) -> None:
    save_coefficients(make_table(sample_ids=("a", "b", "a", "a")), tmp_path / "faces.h5")
    with pytest.raises(InputFileError, match=r"faces\.h5: expected unique sample ids, found 2 repeated"):
        load_coefficients(tmp_path / "faces.h5")


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["identity", "expression", "cameras"])
def test_a_row_that_is_not_finite_is_named(path: Path, name: str, value: float) -> None:
    with h5py.File(path, "r+") as file:
        file[name][2] = value
    with pytest.raises(InputFileError, match=f"faces.h5: {name} of 'face/2' is not finite"):
        load_coefficients(path)


def replace_column(path: Path, name: str, values: object) -> None:
    with h5py.File(path, "r+") as file:
        del file[name]
        file[name] = values


@pytest.mark.parametrize("name", ARRAYS)
def test_columns_of_other_lengths_are_refused(path: Path, name: str) -> None:
    replace_column(path, name, getattr(make_table(), name)[:3])
    with pytest.raises(InputFileError, match=rf"faces\.h5: expected {name} of shape \(4, .*\), found \(3, "):
        load_coefficients(path)


def test_too_few_pictures_are_refused(path: Path) -> None:
    replace_column(path, "image_paths", json_lines(["a.jpg", "b.jpg"]))
    with pytest.raises(InputFileError, match=r"faces\.h5: expected 4 rows of image_paths, found 2"):
        load_coefficients(path)


@pytest.mark.parametrize("name", [*ARRAYS, "image_paths", "sample_ids"])
def test_a_missing_column_is_refused(path: Path, name: str) -> None:
    with h5py.File(path, "r+") as file:
        del file[name]
    with pytest.raises(InputFileError, match=f"faces.h5: expected .*{name}"):
        load_coefficients(path)


@pytest.mark.parametrize("name", ["cameras", "sample_ids", "lighting"])
def test_types_in_place_of_columns_are_refused(path: Path, name: str) -> None:
    with h5py.File(path, "r+") as file:
        if name in file:
            del file[name]
        file[name] = np.dtype("i4")
    with pytest.raises(InputFileError, match=rf"faces\.h5: expected (numbers|lines of text) as {name}"):
        load_coefficients(path)


@pytest.mark.parametrize("shape", [(), (4,), (4, 3), (4, 4, 4, 1)])
@pytest.mark.parametrize("name", ["cameras", "sizes_px"])
def test_columns_of_other_shapes_are_refused(path: Path, name: str, shape: tuple[int, ...]) -> None:
    replace_column(path, name, np.zeros(shape))
    with pytest.raises(InputFileError, match=rf"faces\.h5: expected {name} of shape"):
        load_coefficients(path)


@pytest.mark.parametrize(
    "values",
    [
        np.arange(4),
        b"one string",
        np.array([b"a", b"b", b"\xff", b"d"]),
        np.zeros((4, 2), np.uint8),
        json_lines(["a", "b", 3, "d"]),
        np.frombuffer(b'"a"\n"b"\n"c","d"\n', np.uint8),
        np.frombuffer(b'"a"\n"b"\n"c"\n"d"', np.uint8),
        np.frombuffer(b'"a"\n"b"\n"\xff"\n"d"\n', np.uint8),
    ],
)
def test_ids_that_are_no_texts_are_refused(path: Path, values: object) -> None:
    replace_column(path, "sample_ids", values)
    with pytest.raises(InputFileError, match=r"faces\.h5: expected .* sample_ids"):
        load_coefficients(path)


@pytest.mark.parametrize("size", [(0, 64), (64, -1), (20_000, 64)])
def test_sizes_that_no_picture_has_are_refused(path: Path, size: tuple[int, int]) -> None:
    with h5py.File(path, "r+") as file:
        file["sizes_px"][1] = size
    with pytest.raises(InputFileError, match=r"faces\.h5: expected pictures of 1 to 16384 pixels.*'face/1'"):
        load_coefficients(path)


@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_table_is_refused_with_one_clear_line(path: Path, fraction: float) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * fraction)])
    with pytest.raises(InputFileError, match="datagen sample") as caught:
        load_coefficients(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_foreign_and_missing_files_are_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["x"] = np.zeros(3)
    with pytest.raises(InputFileError, match="format='pix2face-coefficients', found format=None"):
        load_coefficients(tmp_path / "foreign.h5")
    (tmp_path / "text.h5").write_text("identity, expression\n")
    with pytest.raises(InputFileError, match=r"text\.h5: expected a table"):
        load_coefficients(tmp_path / "text.h5")
    with pytest.raises(InputFileError, match=r"nothing\.h5: expected a table"):
        load_coefficients(tmp_path / "nothing.h5")


def test_a_newer_table_is_refused_with_that_word(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        file.attrs["schema_version"] = 3
    with pytest.raises(InputFileError, match="schema 3 is newer than 2"):
        load_coefficients(path)


def test_an_older_table_is_refused_with_what_to_do(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        file.attrs["format"], file.attrs["schema_version"] = "pix2face-coefficients", 1
    with pytest.raises(InputFileError, match=r"schema 2, found 1 of an earlier version; make it again"):
        load_coefficients(path)


def test_a_table_of_another_model_names_both(path: Path, tmp_path: Path) -> None:
    assert len(TableSource(path, MODEL).sample_ids) == 4
    other = tmp_path / "other.h5"
    save_coefficients(make_table(model_name="Basel", model_sha256="e" * 64), other)
    with pytest.raises(ModelMismatchError) as caught:
        open_source(other, MODEL)
    for expected in ("other.h5", "Basel", "e" * 12, MODEL.name, MODEL.sha256[:12], "--model"):
        assert expected in str(caught.value)


def test_coefficients_of_another_number_than_the_models_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "faces.h5"
    save_coefficients(make_table(identity=np.zeros((4, 5), dtype=np.float32)), path)
    with pytest.raises(InputFileError, match=r"faces\.h5: expected 12 identity and 6 expression .*found 5 and 6"):
        open_source(path, MODEL)


def test_tables_without_the_later_columns_are_read(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file["attributes"], file["rejected"], file.attrs["licence"]
    table = load_coefficients(path)
    assert (table.attributes, table.rejected, table.licence, table.lighting) == ((), (), "", None)
    assert table.face(0, path.parent).attributes == {}


@pytest.mark.parametrize("text", ["", "[1]", '{"yaw_deg": null}', "{", '"text"'])
def test_attributes_that_are_no_json_are_refused(path: Path, text: str) -> None:
    replace_column(path, "attributes", np.frombuffer(f"{{}}\n{text}\n{{}}\n{{}}\n".encode(), np.uint8))
    with pytest.raises(
        InputFileError,
        match=r"expected (a JSON object of texts and numbers as attributes of 'face/1'|JSON in each line)",
    ):
        load_coefficients(path)


def test_attributes_of_another_number_than_faces_are_refused(path: Path) -> None:
    replace_column(path, "attributes", json_lines([{}]))
    with pytest.raises(InputFileError, match="expected 4 rows of attributes, found 1"):
        load_coefficients(path)


def test_a_table_that_points_out_of_itself_is_refused(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file["identity"]
        file["identity"] = h5py.ExternalLink("/somewhere/else.h5", "/identity")
    with pytest.raises(InputFileError, match="links elsewhere"):
        load_coefficients(path)


def test_nothing_has_a_variable_length(path: Path) -> None:
    """Damaged, it could end the process inside the HDF5 library."""
    with h5py.File(path) as file:
        assert all(item.dtype.kind != "O" for item in file.values())
        assert all(file.attrs.get_id(name).dtype.kind != "O" for name in file.attrs)
