"""``datagen model import``, ``info`` and ``view``, as users type them."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from datagen.cli import main
from datagen.opengl.gl_context import GLContext
from pix2face.geometry.landmarks import IBUG68
from pix2face.model_formats.model_import import ImportedModel
from pix2face.models.model_file import write_stored_model
from pix2face.models.morphable_model import builtin_model, load_model
from tests.full_disk import FULL, files_of_at_most
from tests.model_files import stored_small_head
from tests.published_models import Head, write_bfm


@pytest.fixture
def bfm_folder(tmp_path: Path) -> Path:
    folder = tmp_path / "bfm"
    folder.mkdir()
    model = builtin_model()
    head = Head(model.mean.astype(np.float64), model.identity_basis[:4], model.expression_basis[:2], model.triangles)
    return write_bfm(folder, head, model.landmarks[IBUG68])


def test_import_says_what_it_did_and_what_holds(
    tmp_path: Path, bfm_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "models" / "bfm.h5"
    assert main(["model", "import", str(bfm_folder), "--out", str(out)]) == 0
    said = capsys.readouterr().err
    for words in ("68 published landmarks", "not applied", "University of Basel", "datagen model view", str(out)):
        assert words in said
    assert load_model(out).n_identity == 4


def test_info_prints_what_a_model_is(tmp_path: Path, bfm_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "bfm.h5"
    assert main(["model", "import", str(bfm_folder), "--out", str(out)]) == 0
    capsys.readouterr()
    assert main(["model", "info", str(out)]) == 0
    shown = "".join(line.strip("│┌┐└┘─ ").replace("│", " ") for line in capsys.readouterr().out.splitlines())
    model = load_model(out)
    flat = "".join(shown.split())
    for words in (
        model.sha256,
        "4components",
        "first shares of the variance",
        "bfm2009-300wlp",
        "18427",
        "ibug68 (68)",
    ):
        assert "".join(words.split()) in flat


def test_info_of_the_builtin_model(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["model", "info"]) == 0
    assert "18427, 36592" in capsys.readouterr().out


def test_variance_shares_are_those_of_the_basis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stored = stored_small_head()
    basis = np.zeros((2, len(stored.mean), 3), np.float32)
    basis[0, :, 0], basis[1, :, 1] = 3, 1
    write_stored_model(replace(stored, identity_basis=basis), tmp_path / "a.h5")
    assert main(["model", "info", str(tmp_path / "a.h5")]) == 0
    flat = "".join(capsys.readouterr().out.replace("│", " ").split())
    assert "2components;avertexmoves3.2mm(RMS);firstsharesofthevariance:90.0%,10.0%" in flat


def test_regions_can_be_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(
        "datagen.models.model_cli.import_model", lambda path: ImportedModel(stored_small_head(), ("a note",))
    )
    out = tmp_path / "a.h5"
    assert main(["model", "import", "any", "--out", str(out), "--without", "neck", "scalp"]) == 0
    assert "a note" in capsys.readouterr().err
    model = load_model(out)
    assert model.name.endswith("without neck, scalp")
    assert model.is_face_triangle.all()
    assert main(["model", "import", "any", "--out", str(out), "--without", "beard"]) == 2
    assert "expected regions of" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["import", "{t}/absent", "--out", "{t}/a.h5"], "found no such file"),
        (["import", "{t}", "--out", "{t}/a.h5"], "found a folder with"),
        (["import", "{t}", "--out", "{t}/a.obj"], "a.obj: expected a file ending in .h5 as --out"),
        (["view", "{t}/absent.h5", "--out", "{t}/a.jpg"], "no such model file"),
        (
            ["view", "builtin", "--out", "{t}/a.gif"],
            "expected a file ending in .jpg, .jpeg, .png, .obj, .glb or .ply as --out",
        ),
        (["view", "builtin", "--out", "{t}/a.jpg", "--components", "0"], "at least one component"),
        (["info", "{t}/absent.h5"], "no such model file"),
    ],
)
def test_wrong_calls_are_one_line(
    tmp_path: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["model", *(argument.format(t=tmp_path) for argument in arguments)]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("name", ["imported.h5", "mean.obj", "mean.ply", "mean.glb"])
def test_a_full_disk_is_one_line_that_names_the_file(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "a.h5", tmp_path / "out" / name
    write_stored_model(stored_small_head(), path)
    imported = ImportedModel(stored_small_head(), ())
    monkeypatch.setattr("datagen.models.model_cli.import_model", lambda path: imported)
    with files_of_at_most(3000):
        assert main(["model", "import" if name == "imported.h5" else "view", str(path), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.endswith(f"{FULL}: '{out}'\n")
    assert said.count("\n") == 1
    assert not out.exists()


@pytest.fixture
def one_gl(gl: GLContext, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets the command draw with the context of all tests: a second one would leave the first not current."""
    monkeypatch.setattr("datagen.models.model_view.create_gl_context", lambda: nullcontext(gl))


@pytest.mark.gl
@pytest.mark.usefixtures("one_gl")
def test_contact_sheet_shows_mean_and_components(tmp_path: Path) -> None:
    path, out = tmp_path / "a.h5", tmp_path / "sheets" / "a.png"
    write_stored_model(stored_small_head(), path)
    assert main(["model", "view", str(path), "--out", str(out), "--components", "2"]) == 0
    sheet = cv2.imread(str(out))
    assert sheet is not None
    assert sheet.shape == (5 * 222, 800, 3)
    rows = sheet.reshape(5, 222, 4, 200, 3)[:, 22:]
    drawn = (np.abs(rows.astype(int) - 245).max(axis=-1) > 8).mean(axis=(1, 3))
    assert (drawn[0, :2] > 0.2).all()  # the mean, from two sides
    assert (drawn[0, 2:] == 0).all()
    assert (drawn[1:] > 0.15).all()  # -3 and +3 of each component
    assert (np.abs(rows[1, :, 0].astype(int) - rows[1, :, 2]).max(axis=-1) > 20).mean() > 0.02
    front, side = rows[0, :, 0], rows[0, :, 1]
    assert np.abs(front.astype(int) - front[:, ::-1]).mean() < np.abs(side.astype(int) - side[:, ::-1]).mean()


@pytest.mark.gl
@pytest.mark.usefixtures("one_gl")
def test_a_blendshape_is_shown_itself(tmp_path: Path) -> None:
    path, stored = tmp_path / "a.h5", stored_small_head()
    names = {"smile": np.eye(6, dtype=np.float32)[0]}
    write_stored_model(replace(stored, named_expressions=names, identity_basis=stored.identity_basis[:0]), path)
    assert main(["model", "view", str(path), "--out", str(tmp_path / "a.png"), "--components", "1"]) == 0
    sheet = cv2.imread(str(tmp_path / "a.png"))
    assert sheet is not None
    assert sheet.shape == (2 * 222, 400, 3)


@pytest.mark.parametrize("suffix", [".obj", ".glb", ".ply"])
def test_meshes_open_in_other_programs(tmp_path: Path, suffix: str) -> None:
    path, out = tmp_path / "a.h5", tmp_path / f"mean{suffix}"
    write_stored_model(stored_small_head(), path)
    assert main(["model", "view", str(path), "--out", str(out)]) == 0
    mesh = trimesh.load(out, process=False, force="mesh")
    model = load_model(path)
    assert mesh.faces.shape == model.triangles.shape
    mm_a_unit = 1000 if suffix == ".glb" else 1  # glTF is in metres
    np.testing.assert_allclose(mesh.triangles * mm_a_unit, model.mean[model.triangles], atol=1e-3)


def test_textured_meshes_keep_their_seams(tmp_path: Path) -> None:
    out = tmp_path / "my head.obj"
    assert main(["model", "view", "builtin", "--out", str(out)]) == 0
    (material,) = tmp_path.glob("*.mtl")
    assert " " not in material.name
    assert f"mtllib {material.name}\n" in out.read_text()
    mesh = trimesh.load(out, process=False, force="mesh")
    model = builtin_model()
    np.testing.assert_allclose(mesh.triangles, model.mean[model.triangles], atol=1e-3)
    assert model.uv is not None
    assert model.uv_triangles is not None
    np.testing.assert_allclose(mesh.visual.uv[mesh.faces], model.uv[model.uv_triangles], atol=1e-4)
