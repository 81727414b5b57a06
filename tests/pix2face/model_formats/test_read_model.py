"""Which reader takes a file: its content decides, and what nobody takes is refused with what is supported."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from pix2face.errors import InputFileError
from pix2face.geometry.landmarks import IBUG68
from pix2face.model_formats import read_model
from pix2face.model_formats.bfm2009 import FACE3D_NAMES
from tests.model_files import write_small_head
from tests.published_models import (
    small_head,
    write_bfm,
    write_flame,
    write_gnm,
    write_ict,
    write_original_bfm,
    write_statismo,
    write_surrey,
)
from tests.synthetic_models import small_head_model


def test_names_of_files_do_not_matter(tmp_path: Path) -> None:
    head = small_head()
    assert read_model(write_flame(tmp_path / "a.h5", head)).name == "FLAME (a)"
    assert read_model(write_statismo(tmp_path / "a.pkl", head)).name == "a (statismo)"
    write_gnm(tmp_path / "a.npz", head).replace(tmp_path / "a.bin")
    assert read_model(tmp_path / "a.bin").name == "GNM Head"
    write_surrey(tmp_path, head).replace(tmp_path / "a.npz")
    assert read_model(tmp_path / "a.npz").name == "Surrey Face Model"


def test_models_of_several_files_are_found_by_folder_and_by_any_file(tmp_path: Path) -> None:
    head, keypoints = small_head(), small_head_model().landmarks[IBUG68]
    for folder, name in (("bfm", "BFM 2009 (300W-LP)"), ("original", "BFM 2009"), ("ict", "ICT-FaceKit light")):
        (tmp_path / folder).mkdir()
        if folder == "bfm":
            write_bfm(tmp_path / folder, head, keypoints)
        else:
            (write_original_bfm if folder == "original" else write_ict)(tmp_path / folder, head)
        paths = [tmp_path / folder, *(tmp_path / folder).rglob("*.mat"), *(tmp_path / folder).rglob("generic*.obj")]
        assert len(paths) > 1
        assert {read_model(path).name for path in paths} == {name}


def test_both_layouts_of_bfm_in_one_folder(tmp_path: Path) -> None:
    head = small_head()
    write_original_bfm(write_bfm(tmp_path, head, small_head_model().landmarks[IBUG68]), head)
    assert read_model(tmp_path).name == "BFM 2009 (300W-LP)"
    assert read_model(tmp_path / "01_MorphableModel.mat").name == "BFM 2009"


def test_what_nobody_takes_is_refused_with_what_is_supported(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"] = 1
    np.savez(tmp_path / "a.npz", x=1)
    scipy.io.savemat(tmp_path / "a.mat", {"Shape_Para": np.zeros(199)})
    (tmp_path / "a.txt").write_text("words")
    (tmp_path / "empty").touch()
    (tmp_path / "b.obj").write_text("v 0 0 0\n")
    (tmp_path / "folder").mkdir()
    paths = [*tmp_path.iterdir(), tmp_path, tmp_path / "absent"]
    for path in paths:
        with pytest.raises(
            InputFileError, match=r"expected .*BFM 2009.*FLAME.*Surrey.*ICT-FaceKit.*GNM.*found"
        ) as caught:
            read_model(path)
        assert str(path) in str(caught.value)


def test_an_imported_model_is_not_imported_again(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="imported already"):
        read_model(write_small_head(tmp_path / "a.h5"))


@pytest.mark.parametrize("version", [1, 2, 3, 4])
@pytest.mark.parametrize("expression", ["", "pca", "blendshapes"])
def test_models_of_eos_of_all_versions(tmp_path: Path, version: int, expression: str) -> None:
    head = small_head()
    path = write_surrey(tmp_path, head, version=version, expression=expression)
    stored = read_model(path)
    is_own = expression == "pca" and version >= 2
    np.testing.assert_allclose(stored.mean, head.mean + (2 if is_own else 0), atol=1e-4)
    np.testing.assert_allclose(stored.identity_basis, head.identity, atol=1e-4)
    np.testing.assert_allclose(stored.expression_basis, head.expression, atol=1e-4)
    assert len(stored.named_expressions) == (0 if is_own else len(head.expression))
    assert stored.uv is not None
    assert len(stored.uv) == len(head.mean)
    if version > 1:
        (tmp_path / "expression_blendshapes.bin").unlink()
        assert len(read_model(path).expression_basis) == (len(head.expression) if expression else 0)


def test_a_later_version_of_eos_is_named(tmp_path: Path) -> None:
    path = write_surrey(tmp_path, small_head())
    path.write_bytes((9).to_bytes(4, "little") + path.read_bytes()[4:])
    with pytest.raises(InputFileError, match="eos library of version 1 to 4, found version 9"):
        read_model(path)


def test_the_file_of_face3d_is_that_of_300wlp(tmp_path: Path) -> None:
    head, keypoints = small_head(), small_head_model().landmarks[IBUG68]
    expected = read_model(write_bfm(tmp_path, head, keypoints))
    fields = {}
    for name in ("Model_Shape.mat", "Model_Expression.mat"):
        fields |= scipy.io.loadmat(tmp_path / name)
    model = {theirs: fields[ours] for ours, theirs in FACE3D_NAMES.items() if ours in fields}
    path = tmp_path / "one" / "BFM.mat"
    path.parent.mkdir()
    scipy.io.savemat(path, {"model": model})
    found = read_model(path)
    for name in ("mean", "identity_basis", "expression_basis", "polygons", "identity_unit"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    np.testing.assert_array_equal(found.landmarks[IBUG68], keypoints)
    assert found.published_basis == expected.published_basis


def test_the_model_of_deep_3d_face_reconstruction(tmp_path: Path) -> None:
    head, keypoints = small_head(), small_head_model().landmarks[IBUG68]
    n = head.mean.size
    fields = {
        "meanshape": head.mean.reshape(1, n) / 100,
        "idBase": head.identity.reshape(-1, n).T / 100,
        "exBase": head.expression.reshape(-1, n).T / 100,
        "meantex": np.full((1, n), 51.0),
        "texBase": np.full((n, 1), 2.55),
        "tri": head.triangles[:, [0, 2, 1]] + 1,
        "keypoints": keypoints[None] + 1,
    }
    scipy.io.savemat(tmp_path / "model.mat", fields)
    found = read_model(tmp_path / "model.mat")
    np.testing.assert_allclose(found.mean, head.mean, atol=1e-4)
    np.testing.assert_allclose(found.identity_basis, head.identity, atol=1e-4)
    np.testing.assert_allclose(found.expression_basis, head.expression, atol=1e-4)
    np.testing.assert_array_equal(found.landmarks[IBUG68], keypoints)
    assert found.albedo_mean is not None
    assert found.albedo_mean[0, 0] == pytest.approx(0.2)
    scipy.io.savemat(tmp_path / "model.mat", fields | {"idBase": np.zeros((n - 3, 2))})
    with pytest.raises(InputFileError, match="idBase"):
        read_model(tmp_path / "model.mat")
