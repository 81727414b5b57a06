"""``pix2face predict`` and ``pix2face fit`` from their arguments to files and exit status."""

import json
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from pix2face.commands.cli import main
from pix2face.commands.result_folder import LIST_NAME
from pix2face.files.images import read_photograph
from pix2face.geometry.camera import Camera, pinhole_of
from pix2face.geometry.crops import INFERENCE_SCALE, FaceBox, crop_image, square_crop
from pix2face.geometry.maps import FaceMaps, valid_pixels
from pix2face.inference.predictor import Predictor
from pix2face.models.morphable_model import MorphableModel, load_model
from pix2face.photographs.fit_pictures import CLOUD_PX
from tests.model_files import write_small_head
from tests.pix2face.photographs.seen_faces import (
    HEIGHT_PX,
    SIZE_PX,
    WIDTH_PX,
    PhotographedFace,
    SureDetector,
    exact_predictor,
    photographed_face,
    write_checkpoint,
    write_picture,
)

DOCUMENTATION = Path(__file__).parents[3] / "docs" / "reference" / "file_formats.md"
FIT_FILES = (".json", ".obj", ".glb", "-points.ply", "-maps.png", "-overlay.jpg")
PREDICT_FILES = (".npz", "-maps.png")

Run = Callable[..., int]


@pytest.fixture(scope="module")
def model_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small_head(tmp_path_factory.mktemp("model") / "head.h5")


@pytest.fixture(scope="module")
def model(model_path: Path) -> MorphableModel:
    return load_model(model_path)


@pytest.fixture(scope="module")
def face(model: MorphableModel) -> PhotographedFace:
    return photographed_face(model)


@pytest.fixture
def photograph(face: PhotographedFace, tmp_path: Path) -> Path:
    return write_picture(tmp_path / "person.png", face.photograph())


@pytest.fixture
def exact(face: PhotographedFace, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever checkpoint is named, its network sees the face exactly."""
    use(exact_predictor(face.model, [face.maps()]), monkeypatch)


@pytest.fixture
def fit(exact: None, face: PhotographedFace, model_path: Path, tmp_path: Path) -> Run:
    """Fits the photographs to ``out``, with the true box, a prior for exact maps, and meshes without colours."""

    def run(*arguments: object, box: FaceBox | None = face.box) -> int:
        where = ["--box", box.left, box.top, box.right, box.bottom] if box else []
        options = ["--model", model_path, "--checkpoint", "any", "--regularisation", "1e-3", "--no-silhouette", *where]
        options += [] if "--out" in arguments else ["--out", tmp_path / "out"]
        options += [] if "--colour" in arguments else ["--colour", "none"]
        return call("fit", *arguments, *options)

    return run


@pytest.fixture
def untrained(model: MorphableModel, tmp_path: Path) -> Path:
    return write_checkpoint(tmp_path / "untrained.safetensors", model)


@pytest.fixture
def predict(untrained: Path, tmp_path: Path) -> Run:
    """Predicts maps of the photographs to ``out``, with a network that has learned nothing."""

    def run(*arguments: object) -> int:
        out = [] if "--out" in arguments else ["--out", tmp_path / "out"]
        return call("predict", *arguments, "--box", 80, 40, 200, 160, "--checkpoint", untrained, *out)

    return run


def copies(photograph: Path, folder: Path, names: Sequence[str]) -> list[Path]:
    paths = [folder / name for name in names]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(photograph.read_bytes())
    return paths


def call(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def use(predictor: Predictor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Predictor, "load", lambda path, device=None: predictor)


def written(folder: Path) -> set[str]:
    return {entry.name for entry in folder.iterdir()} - {LIST_NAME}


def documented_fields(heading: str) -> set[str]:
    """The names in backquotes below a heading of docs/reference/file_formats.md."""
    section = DOCUMENTATION.read_text().split(f"## {heading}")[1].split("\n## ")[0].split("\n", 1)[1]
    return set(re.findall(r"`(\w+)`", section))


def test_predicted_maps_are_what_the_documentation_says(
    exact: None, face: PhotographedFace, photograph: Path, tmp_path: Path
) -> None:
    box, out = face.box, tmp_path / "out"
    where = ("--box", box.left, box.top, box.right, box.bottom)
    assert call("predict", photograph, *where, "--checkpoint", "any", "--out", out) == 0
    assert written(out) == {f"person-0{suffix}" for suffix in PREDICT_FILES}
    with np.load(out / "person-0.npz", allow_pickle=False) as file:
        arrays = dict(file)
    assert set(arrays) == documented_fields("Predicted maps")
    true, inside = face.maps(), arrays["mask"]
    np.testing.assert_array_equal(inside, valid_pixels(true.pncc, face.model.smallest_radius_mm))
    assert 2000 < inside.sum() <= true.mask.sum()
    for name in ("pncc", "offset"):
        assert (arrays[name].dtype, arrays[name].shape) == (np.float32, (SIZE_PX, SIZE_PX, 3))
        np.testing.assert_allclose(arrays[name][inside], getattr(true, name)[inside], atol=1e-4)
        assert not arrays[name][~inside].any()
    crop = square_crop(box, INFERENCE_SCALE, SIZE_PX)
    np.testing.assert_array_equal(arrays["image_from_crop"], crop.image_from_crop)
    picture = read_photograph(out / "person-0-maps.png")
    side_px = crop.finest_size_px
    assert picture.shape == (side_px, 3 * side_px, 3)
    np.testing.assert_array_equal(picture[:, :side_px], crop_image(face.photograph(), crop.with_size(side_px)))


def test_maps_are_enlarged_to_the_resolution_of_the_photograph(
    model: MorphableModel, face: PhotographedFace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    near = replace(face, camera=face.camera.transformed(np.diag([2.0, 2.0, 1.0])))
    use(exact_predictor(model, [near.maps()]), monkeypatch)
    photograph = write_picture(tmp_path / "person.png", np.zeros((2 * HEIGHT_PX, 2 * WIDTH_PX, 3), np.uint8))
    where = ("--box", near.box.left, near.box.top, near.box.right, near.box.bottom)
    assert (
        call("predict", photograph, *where, "--resolution", "photograph", "--checkpoint", "any", "--out", tmp_path) == 0
    )
    with np.load(tmp_path / "person-0.npz", allow_pickle=False) as file:
        arrays = dict(file)
    size_px = len(arrays["mask"])
    assert size_px == round(INFERENCE_SCALE * near.box.longer_side) > 1.5 * SIZE_PX
    expected = square_crop(near.box, INFERENCE_SCALE, size_px).image_from_crop
    np.testing.assert_allclose(arrays["image_from_crop"], expected, atol=1e-9)
    np.testing.assert_allclose(expected[:2, :2], np.eye(2), atol=0.01)
    true = near.maps(size_px)
    deep = cv2.erode((true.mask & arrays["mask"]).astype(np.uint8), np.ones((25, 25))).astype(bool)
    assert deep.sum() > 0.2 * true.mask.sum() > 2000
    assert np.abs((arrays["pncc"] - true.pncc)[deep].mean(axis=0)).max() < 0.3  # a pixel is about a millimetre
    assert np.linalg.norm(arrays["pncc"] - true.pncc, axis=2)[deep].mean() < 1.5


def test_a_fit_is_what_the_documentation_says(
    fit: Run, face: PhotographedFace, photograph: Path, tmp_path: Path
) -> None:
    assert fit(photograph) == 0
    out, model = tmp_path / "out", face.model
    assert written(out) == {f"person-0{suffix}" for suffix in FIT_FILES}
    found = json.loads((out / "person-0.json").read_text())
    assert set(found) == documented_fields("Fit")
    assert found["model"] == {"name": model.name, "sha256": model.sha256}
    np.testing.assert_allclose(found["landmarks2d_px"], face.landmarks2d, atol=0.1)
    np.testing.assert_allclose(found["identity"], face.identity, atol=0.1)
    np.testing.assert_allclose(found["expression"], face.expression, atol=0.1)
    for name, angle_deg in zip(
        ("pitch", "yaw", "roll"), (face.pose.pitch_deg, face.pose.yaw_deg, face.pose.roll_deg), strict=True
    ):
        assert found["pose_deg"].pop(name) == pytest.approx(angle_deg, abs=0.2)
    assert found["pose_deg"] == {}
    assert found["px_per_mm"] == pytest.approx(0.7, rel=2e-3)
    camera, landmarks3d = Camera(np.array(found["camera_matrix"])), np.array(found["landmarks3d_mm"])
    np.testing.assert_allclose(camera.project(landmarks3d), found["landmarks2d_px"], atol=1e-6)


@pytest.mark.parametrize("options", [(), ("--regularisation", "estimate")])
def test_by_default_a_fit_is_for_predicted_maps(
    exact: None, face: PhotographedFace, model_path: Path, photograph: Path, tmp_path: Path, options: tuple[str, ...]
) -> None:
    """Held to a mask that lacks its outermost pixel, and to the mean face: a little off on exact maps."""
    where = ("--box", face.box.left, face.box.top, face.box.right, face.box.bottom, "--checkpoint", "any")
    assert call("fit", photograph, "--model", model_path, *where, *options, "--out", tmp_path / "out") == 0
    found = json.loads((tmp_path / "out" / "person-0.json").read_text())
    distances = np.linalg.norm(np.array(found["landmarks2d_px"]) - face.landmarks2d, axis=1)
    assert distances.mean() < 0.5
    assert distances.max() < 1.5


def test_mesh_and_cloud_open_elsewhere(fit: Run, face: PhotographedFace, photograph: Path, tmp_path: Path) -> None:
    assert fit(photograph) == 0
    mesh = trimesh.load(tmp_path / "out" / "person-0.obj", process=False, maintain_order=True)
    np.testing.assert_array_equal(mesh.faces, face.model.triangles)
    assert np.linalg.norm(mesh.vertices - face.vertices, axis=1).max() < 0.5  # mm
    cloud = trimesh.load(tmp_path / "out" / "person-0-points.ply")
    shown = crop_image(face.photograph(), square_crop(face.box, INFERENCE_SCALE, CLOUD_PX))
    true = face.maps(CLOUD_PX)
    inside = cv2.erode(true.mask.astype(np.uint8), np.ones((41, 41))).astype(bool)
    nearest, place = KDTree(cloud.vertices).query((true.pncc + true.offset)[inside])
    assert inside.sum() > 2000
    assert nearest.mean() < 1.0
    whole = KDTree((true.pncc + true.offset)[true.mask])
    assert np.quantile(whole.query(cloud.vertices)[0], 0.95) < 4
    assert 0.9 * true.mask.sum() < len(cloud.vertices) < 1.1 * true.mask.sum()
    # The nearest point may be that of a neighbouring pixel.
    assert np.abs(cloud.colors[place, :3].astype(float) - shown[inside]).mean() < 4
    overlay = read_photograph(tmp_path / "out" / "person-0-overlay.jpg")
    assert overlay.shape[2] == 3
    assert overlay.std() > 20


def test_the_camera_is_of_the_kind_that_was_asked_for(
    fit: Run, face: PhotographedFace, photograph: Path, tmp_path: Path
) -> None:
    for kind in ("affine", "weak-perspective", "pinhole"):
        assert fit(photograph, "--camera", kind, "--mesh", "none") == 0
        found = json.loads((tmp_path / "out" / "person-0.json").read_text())
        np.testing.assert_allclose(found["landmarks2d_px"], face.landmarks2d, atol=0.3)
        assert found["camera_kind"] == ("weak-perspective" if kind == "affine" else kind)  # as this face was drawn
    principal_point = pinhole_of(Camera(np.array(found["camera_matrix"]))).principal_point_px
    np.testing.assert_allclose(principal_point, [WIDTH_PX / 2, HEIGHT_PX / 2], atol=1e-3)


def test_photographs_that_cannot_be_read_do_not_end_the_run(
    fit: Run, photograph: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"\xff\xd8 no picture")
    assert fit(broken, tmp_path / "nothing.png", photograph) == 3
    assert written(tmp_path / "out") == {f"person-0{suffix}" for suffix in FIT_FILES}
    error = capsys.readouterr().err
    for name, times in ((broken, 1), (tmp_path / "nothing.png", 2)):  # at once, and in the end
        assert sum(line.startswith(f"{name}: expected a picture") for line in error.splitlines()) == times


def test_a_box_beside_one_photograph_leaves_the_others(
    fit: Run, photograph: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = write_picture(tmp_path / "small.png", np.zeros((20, 30, 3), np.uint8))
    assert fit(small, photograph) == 3
    assert f"{small}: --box lies beside the picture of 30 x 20 pixels" in capsys.readouterr().err.splitlines()
    assert "person-0.json" in written(tmp_path / "out")


def test_nothing_is_overwritten_whatever_the_names(predict: Run, photograph: Path, tmp_path: Path) -> None:
    names = ("a/x.png", "b/x.png", "x.2.png", "X-0.png", "c/X.png", "y.png")
    assert predict(*copies(photograph, tmp_path, names)) == 0
    expected = ("x-0", "x.3-0", "x.2-0", "X-0-0", "X.4-0", "y-0")
    assert written(tmp_path / "out") == {f"{name}{suffix}" for name in expected for suffix in PREDICT_FILES}


@pytest.fixture
def two_faces(model: MorphableModel, monkeypatch: pytest.MonkeyPatch) -> list[PhotographedFace]:
    """Two faces, the first the larger one, are detected in every photograph."""
    faces = [photographed_face(model, seed, centre) for seed, centre in ((1, (140, 100)), (2, (90, 120)))]
    faces.sort(key=lambda face: -face.box.longer_side)
    detector = SureDetector([face.box for face in faces])
    monkeypatch.setattr("pix2face.api.open_detector", lambda *call: detector)
    return faces


def test_several_faces_are_numbered(
    two_faces: list[PhotographedFace], fit: Run, photograph: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(exact_predictor(two_faces[0].model, [face.maps() for face in two_faces]), monkeypatch)
    other = write_picture(tmp_path / "person-1.png", two_faces[0].photograph())
    assert fit(photograph, other, "--no-refine", box=None) == 0
    assert len(written(tmp_path / "out")) == 4 * len(FIT_FILES)
    for index, face in enumerate(two_faces):
        found = json.loads((tmp_path / "out" / f"person-{index}.json").read_text())
        np.testing.assert_allclose(found["landmarks2d_px"], face.landmarks2d, atol=0.1)


def test_the_largest_face_alone_has_the_first_number(
    two_faces: list[PhotographedFace], fit: Run, photograph: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(exact_predictor(two_faces[0].model, [two_faces[0].maps()]), monkeypatch)
    assert fit(photograph, "--largest", "--no-refine", box=None) == 0
    assert written(tmp_path / "out") == {f"person-0{suffix}" for suffix in FIT_FILES}


def test_a_face_that_cannot_be_fitted_leaves_the_other_one(
    two_faces: list[PhotographedFace],
    fit: Run,
    photograph: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    zeros = np.zeros((SIZE_PX, SIZE_PX, 3), dtype=np.float32)
    nothing = FaceMaps(zeros, zeros, np.zeros((SIZE_PX, SIZE_PX), dtype=bool))
    use(exact_predictor(two_faces[0].model, [nothing, two_faces[1].maps()]), monkeypatch)
    assert fit(photograph, "--no-refine", box=None) == 3
    assert written(tmp_path / "out") == {f"person-1{suffix}" for suffix in FIT_FILES}
    lines = capsys.readouterr().err.splitlines()
    assert sum(line.startswith(f"{photograph}: expected maps with a face") for line in lines) == 1
    assert any(line.startswith("photographs: 1, faces: 1 ") for line in lines)


def test_names_are_kept_in_files_and_shown_as_they_stand(
    predict: Run, photograph: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ["[red]me[", "..", "a:smile:b", "tab\tline\nescape\x1b[31m", "-x", os.fsdecode(b"caf\xe9")]
    before = written(tmp_path)
    missing = [tmp_path / f"{name}.png" for name in names]
    assert predict(*copies(photograph, tmp_path / "in", [path.name for path in missing]), *missing) == 3
    assert written(tmp_path / "out") == {f"{name}-0{suffix}" for name in names for suffix in PREDICT_FILES}
    assert written(tmp_path) == before | {"in", "out"}
    error = capsys.readouterr().err
    for name in names:
        shown = name.translate({9: "\\t", 10: "\\n", 27: "\\x1b", 0xDCE9: "\\udce9"})
        assert f"{tmp_path}/{shown}.png: expected a picture" in error


def test_the_checkpoint_trained_last_is_the_default(
    photograph: Path, model: MorphableModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_checkpoint(tmp_path / "runs" / "tiny" / "checkpoint.safetensors", model)
    assert call("predict", photograph, "--box", 80, 40, 200, 160) == 0
    assert written(tmp_path / "out" / "predict") == {"person-0.npz", "person-0-maps.png"}


def test_a_second_run_replaces_its_own_files_and_gives_the_same_bytes(
    fit: Run, photograph: Path, tmp_path: Path
) -> None:
    assert fit(photograph, "--colour", "vertex") == 0
    before = {name: (tmp_path / "out" / name).read_bytes() for name in written(tmp_path / "out")}
    assert fit(photograph, "--colour", "vertex") == 0
    assert {name: (tmp_path / "out" / name).read_bytes() for name in written(tmp_path / "out")} == before


def test_fewer_faces_than_before_leave_none_of_the_earlier_run(
    two_faces: list[PhotographedFace], fit: Run, photograph: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(exact_predictor(two_faces[0].model, [face.maps() for face in two_faces]), monkeypatch)
    out = tmp_path / "out"
    assert fit(photograph, "--no-refine", box=None) == 0
    for name in ("person-1.txt", "person-7.json", "person-2.obj", "notes.json"):
        (out / name).write_text("not ours")
    assert fit(photograph, "--no-refine", "--largest", "--mesh", "obj", box=None) == 0
    kept = {"person-1.txt", "person-7.json", "person-2.obj", "notes.json"}
    assert written(out) == kept | {f"person-0{suffix}" for suffix in FIT_FILES if suffix != ".glb"}
    assert all((out / name).read_text() == "not ours" for name in kept)


def test_a_folder_and_a_pattern_stand_for_their_photographs(
    predict: Run, photograph: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "photos"
    copies(photograph, folder, ("b10.png", "b9.png", "sub/c.png"))
    (folder / "notes.txt").write_text("no picture")
    out = ("--out", folder)  # results beside the photographs are no photographs
    for given in (folder, folder / "*.png"):
        assert predict(given, *out) == 0
        assert "photographs: 2, faces: 2 ->" in capsys.readouterr().err
    assert predict(folder / "**" / "c.*") == 0
    assert written(tmp_path / "out") == {f"c-0{suffix}" for suffix in PREDICT_FILES}
    (tmp_path / "empty").mkdir()
    assert predict(tmp_path / "empty") == 2
    assert "in the folder, found none" in capsys.readouterr().err
    (tmp_path / "empty" / "person-0.json").touch()
    assert call("view", tmp_path / "empty") == 2
    assert f"found none; name the fits in it as '{tmp_path}/empty/*.json'" in capsys.readouterr().err
    assert predict(folder / "*.gif") == 2
    assert f"{folder}/*.gif: expected a picture" in capsys.readouterr().err
