"""What the options of ``pix2face fit``, ``predict`` and ``view`` change, from the command line to the files."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pix2face.commands.cli import main
from pix2face.commands.result_folder import LIST_NAME
from pix2face.geometry.camera import HeadPose
from pix2face.geometry.landmarks import IBUG68_2D
from pix2face.inference.predictor import Predictor
from pix2face.models.morphable_model import MorphableModel, builtin_model
from pix2face.models.surface_attributes import split_at_seams
from tests.cameras import posed_camera
from tests.pix2face.photographs.seen_faces import PhotographedFace, exact_predictor, photographed_face, write_picture
from tests.pix2face.scene_readers import GltfScene, usd_complaints, usd_pixels
from tests.synthetic_models import small_head_model
from tests.textured_head import textured_head

Run = Callable[..., int]


def call(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def written(folder: Path) -> set[str]:
    return {entry.name for entry in folder.iterdir()} - {LIST_NAME}


@pytest.fixture
def with_model(monkeypatch: pytest.MonkeyPatch) -> Callable[[MorphableModel, Predictor], None]:
    """Sets the model and the network that every command opens."""

    def use(model: MorphableModel, predictor: Predictor) -> None:
        monkeypatch.setattr("pix2face.landmark_choice.landmark_file.open_model", lambda name: model)
        monkeypatch.setattr("pix2face.commands.view_cli.open_model", lambda name: model)
        monkeypatch.setattr(Predictor, "load", lambda path, device=None: predictor)

    return use


@pytest.fixture
def textured(with_model: Callable[..., None]) -> PhotographedFace:
    face = photographed_face(textured_head())
    with_model(face.model, exact_predictor(face.model, [face.maps()]))
    return face


@pytest.fixture
def plain(with_model: Callable[..., None]) -> PhotographedFace:
    face = photographed_face(small_head_model())
    with_model(face.model, exact_predictor(face.model, [face.maps()]))
    return face


def where(face: PhotographedFace) -> tuple[object, ...]:
    box = face.box
    return ("--box", box.left, box.top, box.right, box.bottom, "--checkpoint", "any")


REST = {"person-0.json", "person-0-points.ply", "person-0-maps.png", "person-0-overlay.jpg"}


@pytest.mark.parametrize(
    ("options", "files"),
    [
        (("--mesh", "obj,glb"), {"person-0.obj", "person-0.mtl", "person-0-texture.png", "person-0.glb"}),
        (("--mesh", "obj", "--colour", "vertex"), {"person-0.obj"}),
        (("--mesh", "ply,glb,usdz", "--colour", "none"), {"person-0.ply", "person-0.glb", "person-0.usdz"}),
        (("--mesh", "none"), set()),
    ],
)
def test_the_meshes_that_were_asked_for(
    textured: PhotographedFace, tmp_path: Path, options: tuple[str, ...], files: set[str]
) -> None:
    photograph = write_picture(tmp_path / "person.png", textured.photograph())
    assert call("fit", photograph, *where(textured), *options, "--out", tmp_path / "out") == 0
    assert written(tmp_path / "out") == REST | files


@pytest.mark.parametrize("colour", ["vertex", "texture"])
def test_the_face_has_the_colours_of_its_photograph(textured: PhotographedFace, tmp_path: Path, colour: str) -> None:
    """Skin in the photograph is red before green before blue, the background blue: so is the mesh."""
    photograph = write_picture(tmp_path / "person.png", textured.photograph())
    options = ("--mesh", "obj,ply,glb", "--colour", colour, "--regularisation", "1e-3", "--no-silhouette")
    assert call("fit", photograph, *where(textured), *options, "--out", tmp_path / "out") == 0
    for suffix in ("obj", "ply", "glb"):
        mesh = trimesh.load(tmp_path / "out" / f"person-0.{suffix}", process=False, force="mesh")
        assert mesh.faces.shape == textured.model.triangles.shape
        mm_a_unit = 1000 if suffix == "glb" else 1
        np.testing.assert_allclose(mesh.extents * mm_a_unit, np.ptp(textured.vertices, axis=0), atol=1)
        visual = mesh.visual.to_color() if mesh.visual.kind == "texture" else mesh.visual
        of_corners = visual.vertex_colors[mesh.faces][..., :3].astype(int)
        red, green, blue = np.median(of_corners[textured.model.is_face_triangle].reshape(-1, 3), axis=0)
        assert red > green + 10, suffix
        assert green > blue + 5, suffix


@pytest.mark.parametrize(("camera", "colour"), [("weak-perspective", "texture"), ("pinhole", "vertex")])
def test_other_programs_see_the_landmarks_where_the_fit_has_them(
    textured: PhotographedFace, tmp_path: Path, camera: str, colour: str
) -> None:
    """The mesh of each file through the camera of the same file."""
    photograph = write_picture(tmp_path / "person.png", textured.photograph())
    options = ("--mesh", "glb,usdz", "--colour", colour, "--camera", camera, "--out", tmp_path)
    assert call("fit", photograph, *where(textured), *options) == 0
    size_px = textured.photograph().shape[:2]
    model, landmarks = textured.model, json.loads((tmp_path / "person-0.json").read_text())["landmarks2d_px"]
    vertices = model.landmarks["ibug68"]
    np.testing.assert_allclose(usd_pixels(tmp_path / "person-0.usdz", size_px)[vertices], landmarks, atol=1e-3)
    assert usd_complaints(tmp_path / "person-0.usdz") == []
    in_glb = np.searchsorted(split_at_seams(model)[0], vertices) if colour == "texture" else vertices
    np.testing.assert_allclose(GltfScene(tmp_path / "person-0.glb").pixels(size_px)[in_glb], landmarks, atol=1e-3)


def test_a_model_without_texture_coordinates_gets_vertex_colours(plain: PhotographedFace, tmp_path: Path) -> None:
    photograph = write_picture(tmp_path / "person.png", plain.photograph())
    assert call("fit", photograph, *where(plain), "--mesh", "ply", "--out", tmp_path / "out") == 0
    mesh = trimesh.load(tmp_path / "out" / "person-0.ply", process=False)
    assert mesh.visual.kind == "vertex"


def test_a_texture_that_cannot_be_is_one_line(
    plain: PhotographedFace, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = (*where(plain), "--colour", "texture", "--out", tmp_path / "out")
    photograph = write_picture(tmp_path / "any.png", plain.photograph())
    assert call("fit", photograph, *options) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "take --colour vertex" in error
    assert not (tmp_path / "out").exists()


def test_maps_in_every_format(plain: PhotographedFace, tmp_path: Path) -> None:
    photograph = write_picture(tmp_path / "person.png", plain.photograph())
    assert call("predict", photograph, *where(plain), "--format", "npz,png16,exr", "--out", tmp_path / "out") == 0
    layers = {f"person-0-{name}" for name in ("pncc.png", "offset.png", "mask.png", "crop.json", "maps.png")}
    assert written(tmp_path / "out") == layers | {"person-0.npz", "person-0.exr"}


def test_a_cloud_and_a_mesh_of_one_name_stay_apart(plain: PhotographedFace, tmp_path: Path) -> None:
    names = ("a", "a-points", "a-points-points")
    photographs = [write_picture(tmp_path / f"{name}.png", plain.photograph()) for name in names]
    for order in (photographs, photographs[::-1]):
        out = tmp_path / f"out-{order[0].stem}"
        assert call("fit", *order, *where(plain), "--mesh", "ply", "--colour", "none", "--out", out) == 0
        assert len(written(out)) == 5 * len(names)


def test_boxes_from_a_file(plain: PhotographedFace, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photograph = write_picture(tmp_path / "person.png", plain.photograph())
    other = write_picture(tmp_path / "other.png", plain.photograph())
    box = plain.box
    boxes = tmp_path / "boxes.csv"
    boxes.write_text(f"image,left,top,right,bottom\nperson.png,{box.left},{box.top},{box.right},{box.bottom}\n")
    options = (
        "--boxes",
        boxes,
        "--checkpoint",
        "any",
        "--regularisation",
        "1e-3",
        "--no-silhouette",
        "--out",
        tmp_path / "out",
    )
    assert call("fit", photograph, other, *options) == 3
    found = json.loads((tmp_path / "out" / "person-0.json").read_text())
    np.testing.assert_allclose(found["landmarks2d_px"], plain.landmarks2d, atol=0.1)
    assert f"{other}: no box in {boxes}; add a line for this photograph" in capsys.readouterr().err
    assert call("fit", photograph, *where(plain), "--boxes", boxes) == 2
    assert "expected --box or --boxes, found both" in capsys.readouterr().err
    boxes.write_text("image,left,top,right,bottom\nperson.png,900,900,990,990\n")
    assert call("fit", photograph, *options) == 3
    assert f"a box of {boxes} lies beside the picture" in capsys.readouterr().err


def test_a_page_of_photographs_and_of_fits(
    textured: PhotographedFace, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = "a<img src=x onerror=alert(1)>"
    photograph = write_picture(tmp_path / f"{name}.png", textured.photograph())
    assert call("fit", photograph, *where(textured), "--out", tmp_path / "out") == 0
    fit, page = tmp_path / "out" / f"{name}-0.json", tmp_path / "page" / "view.html"
    assert call("view", photograph, fit, *where(textured), "--out", page) == 0
    data = json.loads(page.read_text().split('id="faces">')[1].split("</script>")[0])
    assert [face["name"] for face in data] == [f"{name}-0"] * 2
    # Coefficients, camera and cloud are those of the fit: the page of a file is the page of its photograph.
    assert data[0]["positions"] == data[1]["positions"]
    assert data[0]["points"] == data[1]["points"]
    assert "<img src=x" not in page.read_text()


def test_a_page_needs_no_network_for_fits_alone(
    plain: PhotographedFace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    photograph = write_picture(tmp_path / "person.png", plain.photograph())
    assert call("fit", photograph, *where(plain), "--mesh", "none", "--out", tmp_path / "out") == 0
    monkeypatch.setattr(Predictor, "load", lambda path, device=None: pytest.fail("a network was loaded"))
    fit, page = tmp_path / "out" / "person-0.json", tmp_path / "view.html"
    (tmp_path / "out" / "person-0-points.ply").unlink()
    assert call("view", fit, "--out", page) == 0
    assert '"points": ""' in page.read_text()
    (tmp_path / "out" / "person-0-points.ply").write_bytes(b"no cloud")
    photograph.unlink()
    assert call("view", fit, tmp_path / "none.json", "--out", tmp_path / "other.html") == 3
    lines = capsys.readouterr().err.splitlines()
    assert sum("person-0-points.ply: expected a point cloud" in line for line in lines) == 1
    assert sum("none.json: expected a fit" in line for line in lines) == 1
    assert not (tmp_path / "other.html").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "expected at least one photograph or a fit"),
        (("fit.json", "--out", "view.txt"), "expected a file ending in .html"),
        (("fit.json", "--regularisation", "0"), "expected a positive --regularisation"),
    ],
)
def test_wrong_calls_of_view_are_one_line(
    arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("view", *arguments) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_a_pipe_or_device_is_refused_at_once(
    plain: PhotographedFace, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    if kind == "pipe":
        os.mkfifo(tmp_path / "pipe")
    path = tmp_path / "pipe" if kind == "pipe" else Path("/dev/zero")
    assert call("fit", path, *where(plain), "--out", tmp_path / "out") == 2
    assert f"{path}: expected a picture, found a device, pipe or socket" in capsys.readouterr().err


def test_landmarks_are_those_that_people_mark_on_request(with_model: Callable[..., None], tmp_path: Path) -> None:
    model, pose = builtin_model(), HeadPose(0, 45, 0)
    camera = posed_camera(140, 100, yaw_deg=45, scale=0.7)
    face = PhotographedFace(model, np.zeros(model.n_identity), np.zeros(model.n_expression), pose, camera)
    with_model(model, exact_predictor(model, [face.maps()]))
    photograph = write_picture(tmp_path / "person.png", face.photograph())
    fits = []
    for landmark_type in ("3d", "2d"):
        out = tmp_path / landmark_type
        options = ("--mesh", "none", "--landmark-type", landmark_type, "--out", out)
        assert call("fit", photograph, *where(face), *options) == 0
        fits.append(json.loads((out / "person-0.json").read_text()))
    fixed, marked = (np.array(fit["landmarks2d_px"]) for fit in fits)
    np.testing.assert_allclose(fixed, face.landmarks2d, atol=0.5)
    np.testing.assert_allclose(marked[17:], camera.project(model.mean_landmarks(IBUG68_2D))[17:], atol=0.5)
    assert np.linalg.norm(fixed - marked, axis=1)[:17].max() > 5
    assert fits[0]["landmarks3d_mm"] == fits[1]["landmarks3d_mm"]
    visible = np.array(fits[0]["landmarks_visible"])
    assert visible[[27, 30, 33, 8]].all()
    assert visible[36] != visible[45] or visible[:8].any() != visible[9:17].any()  # one side of the head is hidden


def test_a_fit_that_is_viewed_keeps_its_landmarks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "person.json").write_text("{}")
    out = tmp_path / "view.html"
    assert call("view", tmp_path / "person.json", "--landmarks", tmp_path / "chosen.json", "--out", out) == 2
    assert "which keeps the landmarks it was written with" in capsys.readouterr().err
    assert not out.exists()


def test_the_landmarks_of_a_file_take_the_place_of_the_models(plain: PhotographedFace, tmp_path: Path) -> None:
    model = plain.model
    chosen = np.roll(model.landmarks["ibug68"], 1)
    content = {
        "format": "pix2face-landmarks",
        "schema_version": 1,
        "scheme": "ibug68",
        "vertices": chosen.tolist(),
        "model": {"name": model.name, "sha256": model.sha256},
    }
    (tmp_path / "chosen.json").write_text(json.dumps(content))
    photograph = write_picture(tmp_path / "person.png", plain.photograph())
    options = ("--landmarks", tmp_path / "chosen.json", "--mesh", "none", "--regularisation", "1e-3", "--no-silhouette")
    assert call("fit", photograph, *where(plain), *options, "--out", tmp_path / "out") == 0
    found = np.array(json.loads((tmp_path / "out/person-0.json").read_text())["landmarks2d_px"])
    np.testing.assert_allclose(found, np.roll(plain.landmarks2d, 1, axis=0), atol=0.5)
