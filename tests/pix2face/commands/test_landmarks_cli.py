import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from pix2face.commands.cli import main
from pix2face.errors import InputFileError, ModelMismatchError
from pix2face.face_files.coefficients import FaceCoefficients, load_coefficients, save_coefficients
from pix2face.files.images import encode_image, read_photograph
from pix2face.fitting.face_fit import face_of_coefficients
from pix2face.geometry.camera import Camera
from pix2face.geometry.landmarks import IBUG68, IBUG68_2D, INNER51, MIRROR_IBUG68, SCHEMES
from pix2face.landmark_choice.landmark_file import load_landmarks, with_landmarks
from pix2face.models.morphable_model import builtin_model

N_FRAMES = 6


@pytest.fixture
def annotated_faces(tmp_path):
    """Photographs (grey) with points at vertices that are not the model's own landmarks, and the table of their fits.

    Every second point is one of the face's vertices beside the landmark, and its mirror image that of the other side.
    """
    from datagen.sampling.faces import sample_faces

    model = builtin_model()
    table = sample_faces(model, N_FRAMES, 5, 256)
    points = model.landmarks[IBUG68].copy()
    face = np.flatnonzero(model.is_face_vertex)
    for landmark, other in enumerate(MIRROR_IBUG68):
        if landmark % 2 or landmark >= other:
            continue
        distances = np.linalg.norm(model.mean[face] - model.mean[points[landmark]], axis=1)
        points[landmark] = face[np.argsort(distances)[6]]
        points[other] = model.symmetry[points[landmark]]
    folder = tmp_path / "data"
    folder.mkdir()
    names = tuple(f"face{index}" for index in range(N_FRAMES))
    for index, name in enumerate(names):
        vertices = model.vertices(table.identity[index][None], table.expression[index][None])[0]
        pixels = Camera(table.cameras[index]).project(vertices[points]) + 0.5
        lines = "\n".join(f"{x:.9f} {y:.9f}" for x, y in pixels)
        (folder / f"{name}.pts").write_text(f"version: 1\nn_points: 68\n{{\n{lines}\n}}\n")
        (folder / f"{name}.png").write_bytes(encode_image(np.full((256, 256, 3), 128, np.uint8)))
    named = FaceCoefficients(**{**vars(table), "sample_ids": names})
    save_coefficients(named, tmp_path / "fits.h5")
    return folder, tmp_path / "fits.h5", points


def test_points_beside_the_surface_are_chosen_with_their_offsets(annotated_faces, tmp_path):
    """Three millimetres in front of the face: no vertex is there."""
    folder, fits, points = annotated_faces
    table, model = load_coefficients(fits), builtin_model()
    for index, name in enumerate(table.sample_ids):
        vertices = model.vertices(table.identity[index][None], table.expression[index][None])[0]
        pixels = Camera(table.cameras[index]).project(vertices[points] + np.float32([0, 0, 3])) + 0.5
        lines = "\n".join(f"{x:.9f} {y:.9f}" for x, y in pixels)
        (folder / f"{name}.pts").write_text(f"version: 1\nn_points: 68\n{{\n{lines}\n}}\n")
    out = tmp_path / "chosen.json"
    assert select(folder, fits, out, "--folds", "3") == 0
    with_offsets = with_landmarks(model, out)
    vertices_alone = replace(with_offsets, landmark_offsets_mm={})
    identity, expression = table.identity[0].astype(float), table.expression[0].astype(float)
    true = model.vertices(identity[None], expression[None])[0, points] + np.float32([0, 0, 3])
    errors = [
        np.linalg.norm(
            face_of_coefficients(own, Camera(table.cameras[0]), identity, expression).landmarks3d - true, axis=1
        )
        for own in (with_offsets, vertices_alone)
    ]
    assert errors[0].mean() < 0.92 * errors[1].mean()  # six frames shrink offsets to a quarter


def select(folder, fits, out, *more):
    return main(["landmarks", "select", "--data", str(folder), "--coeffs", str(fits), "--out", str(out), *more])


def test_the_annotated_vertices_are_chosen_and_can_be_used(annotated_faces, tmp_path, capsys):
    folder, fits, points = annotated_faces
    out = tmp_path / "chosen.json"
    assert select(folder, fits, out, "--folds", "3") == 0
    content = json.loads(out.read_text())
    np.testing.assert_array_equal(content["vertices"], points)
    assert max(content["held_out_error"]) < 1e-4
    assert np.abs(content["offsets_mm"]).max() <= 0.02
    assert content["n_frames"] == [N_FRAMES] * 68
    assert "held-out" in capsys.readouterr().out
    model = with_landmarks(builtin_model(), out)
    np.testing.assert_array_equal(model.landmarks[IBUG68], points)
    assert IBUG68_2D not in model.landmarks  # the chosen ones are for both types


def test_points_that_people_mark_are_chosen_beside_the_others(annotated_faces, tmp_path):
    folder, fits, points = annotated_faces
    out = tmp_path / "marked.json"
    assert select(folder, fits, out, "--scheme", "ibug68-2d", "--folds", "2") == 0
    model = with_landmarks(builtin_model(), out)
    np.testing.assert_array_equal(model.landmarks[IBUG68_2D], points)
    np.testing.assert_array_equal(model.landmarks[IBUG68], builtin_model().landmarks[IBUG68])


def test_the_inner_points_are_taken_out_of_68(annotated_faces, tmp_path):
    folder, fits, points = annotated_faces
    out = tmp_path / "inner.json"
    assert select(folder, fits, out, "--scheme", "inner51", "--folds", "2") == 0
    np.testing.assert_array_equal(load_landmarks(out).vertices, points[list(INNER51)])


def test_frames_that_cannot_be_used_are_named_and_the_exit_status_tells(annotated_faces, tmp_path, capsys):
    folder, fits, _ = annotated_faces
    shutil.copy(folder / "face0.png", folder / "stranger.png")
    shutil.copy(folder / "face0.pts", folder / "stranger.pts")
    (folder / "face1.pts").write_text("version: 1\nn_points: 67\n{\n}\n")
    assert select(folder, fits, tmp_path / "out.json", "--folds", "2") == 3
    said = " ".join(capsys.readouterr().err.split())
    assert "stranger" in said
    assert "n_points: 67" in said


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--folds", "1"], "--folds"),
        (["--scheme", "menpo84"], "84"),
        (["--checkpoint", "net.safetensors"], "found both"),
    ],
)
def test_wrong_calls_end_in_one_line(annotated_faces, tmp_path, capsys, more, message):
    folder, fits, _ = annotated_faces
    assert select(folder, fits, tmp_path / "out.json", *more) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out.json").exists()


def test_the_landmarks_of_a_model_are_drawn(tmp_path):
    out = tmp_path / "own.png"
    assert main(["landmarks", "show", "--out", str(out)]) == 0
    picture = read_photograph(out).astype(int)
    green = (picture[..., 1] > picture[..., 0] + 80) & (picture[..., 1] > picture[..., 2] + 80)
    assert green.sum() > 500


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "other"}, "something else .*'other'"),
        ({"schema_version": 9}, "newer"),
        ({"vertices": [1, 2, 3]}, "68 vertices"),
        ({"scheme": "unknown"}, "unknown"),
        ({"vertices": ["x"] * 68}, "something else .*Expected `int`"),
        ({"model": 3}, "something else"),
        ({"offsets_mm": [[0, 0, 1]]}, "offsets of 68 landmarks, or none, found 1"),
        ({"offsets_mm": [[0, 1]] * 68}, "something else"),
        ({"offsets_mm": [[0, 0, float("nan")]] * 68}, "something else"),
        ({"vertices": [float("inf")] * 68}, "something else"),
    ],
)
def test_damaged_files_are_refused(tmp_path, change, message):
    path = tmp_path / "landmarks.json"
    model = builtin_model()
    sound = {
        "format": "pix2face-landmarks",
        "schema_version": 1,
        "scheme": IBUG68,
        "vertices": list(range(SCHEMES[IBUG68])),
        "model": {"name": model.name, "sha256": model.sha256},
    }
    path.write_text(json.dumps(sound))
    assert with_landmarks(model, path).landmarks[IBUG68][67] == 67
    np.testing.assert_array_equal(with_landmarks(model, path).mean_landmarks(IBUG68)[67], model.mean[67])
    path.write_text(json.dumps({**sound, **change}))
    with pytest.raises(InputFileError, match=message):
        load_landmarks(path)
    for content in ("no json", "[" * 100_000):
        path.write_text(content)
        with pytest.raises(InputFileError, match="something else"):
            load_landmarks(path)


def test_landmarks_of_another_model_or_mesh_are_refused(tmp_path):
    path = tmp_path / "landmarks.json"
    model = builtin_model()
    content = {
        "format": "pix2face-landmarks",
        "schema_version": 1,
        "scheme": IBUG68,
        "vertices": [10**6] * 68,
        "model": {"name": model.name, "sha256": model.sha256},
    }
    path.write_text(json.dumps(content))
    with pytest.raises(InputFileError, match="1000000"):
        with_landmarks(model, path)
    content["model"] = {"name": "other", "sha256": "0" * 64}
    path.write_text(json.dumps(content))
    with pytest.raises(ModelMismatchError, match="other"):
        with_landmarks(model, path)
