"""Coefficients go from one model to another: exactly where the target can follow, with a stated residual elsewhere."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from datagen.cli import main
from datagen.faces.model_transfer import find_transfer, transfer_table
from datagen.sampling.faces import sample_faces
from pix2face.errors import ModelMismatchError, UsageError
from pix2face.face_files.coefficients import load_coefficients, save_coefficients
from pix2face.geometry.camera import Camera
from pix2face.models.model_file import write_stored_model
from pix2face.models.morphable_model import MorphableModel, builtin_model
from tests.model_files import stored_small_head, write_small_head
from tests.synthetic_models import small_head_model

ROTATION = Rotation.from_euler("xyz", [3, -4, 2], degrees=True).as_matrix()
SHIFT_MM = np.array([1.0, -6.0, 4.0])


def subdivided(head: MorphableModel) -> tuple[np.ndarray, np.ndarray]:
    """Mean and components at the vertices of a mesh with four times the triangles, and these."""
    fields = np.concatenate([head.mean[None], head.identity_basis, head.expression_basis]).astype(np.float64)
    edges = np.sort(head.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, midpoint = np.unique(edges, axis=0, return_inverse=True)
    middle = midpoint.reshape(-1, 3) + len(head.mean)
    a, b, c = head.triangles.T
    ab, bc, ca = middle.T
    triangles = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]).transpose(2, 0, 1).reshape(-1, 3)
    return np.concatenate([fields, fields[:, unique].mean(axis=2)], axis=1), triangles.astype(np.int32)


def other_topology() -> MorphableModel:
    """The small head with four times the triangles, in another frame, its components in another order and sign."""
    head = small_head_model()
    fields, triangles = subdivided(head)
    fields, k = fields @ ROTATION.T, head.n_identity
    return replace(
        head,
        name="other",
        sha256="1" * 64,
        mean=(fields[0] + SHIFT_MM).astype(np.float32),
        identity_basis=-fields[1 : k + 1][::-1].astype(np.float32),
        expression_basis=fields[k + 1 :].astype(np.float32),
        triangles=triangles,
        triangle_regions=np.repeat(head.triangle_regions, 4),
        symmetry=None,
    )


def landmark_pixels(model: MorphableModel, table) -> np.ndarray:  # type: ignore[no-untyped-def]
    vertices = model.vertices(table.identity, table.expression)[:, model.landmarks["ibug68"]]
    return np.stack([Camera(matrix).project(points) for matrix, points in zip(table.cameras, vertices, strict=True)])


@pytest.mark.parametrize(("direction", "through"), [("there", "dense"), ("back", "dense"), ("there", "landmarks")])
def test_a_model_of_the_same_faces_takes_them_over(direction: str, through: str) -> None:
    source, target = small_head_model(), other_topology()
    if direction == "back":
        source, target = target, source
    table = sample_faces(source, 40, 0, 256)
    transferred, residual = transfer_table(table, source, target, through)  # type: ignore[arg-type]
    assert residual.mean_mm < (0.3 if through == "dense" else 1.0)
    assert residual.mean_mm < residual.percentile_95_mm
    assert residual.alignment_mm < 0.3
    assert (transferred.model_sha256, transferred.model_name) == (target.sha256, target.name)
    distances = np.linalg.norm(landmark_pixels(target, transferred) - landmark_pixels(source, table), axis=2)
    assert distances.mean() < (0.5 if through == "dense" else 1.5)
    if through == "dense":
        np.testing.assert_allclose(transferred.identity, -table.identity[:, ::-1], atol=0.35)


def test_the_stated_residual_is_that_of_the_faces() -> None:
    source, target = small_head_model(), other_topology()
    table = sample_faces(source, 10, 0, 256)
    transfer = find_transfer(source, target, "landmarks")
    transferred, residual = transfer_table(table, source, target, "landmarks")
    found = target.vertices(transferred.identity, transferred.expression)[:, target.landmarks["ibug68"]]
    given = source.vertices(table.identity, table.expression)[:, source.landmarks["ibug68"]]
    distances = np.linalg.norm(found - transfer.target_from_source.apply(given.astype(np.float64)), axis=2)
    assert residual.mean_mm == pytest.approx(distances.mean(), abs=1e-3)
    assert residual.percentile_95_mm == pytest.approx(np.percentile(distances, 95), abs=1e-3)
    assert residual.n_points == 68


def test_the_residual_grows_where_the_target_cannot_follow() -> None:
    source = small_head_model()
    other = other_topology()
    stiff = replace(other, identity_basis=other.identity_basis[:4], sha256="2" * 64)
    table = sample_faces(source, 20, 0, 256)
    _, full = transfer_table(table, source, other, "dense")
    _, poor = transfer_table(table, source, stiff, "dense")
    assert poor.mean_mm > 5 * full.mean_mm


def test_a_table_of_another_model_names_both() -> None:
    table = replace(sample_faces(small_head_model(), 2, 0, 64), model_name="third", model_sha256="9" * 64)
    with pytest.raises(ModelMismatchError, match=r"third \(999999999999\), found model small .*--from-model"):
        transfer_table(table, small_head_model(), other_topology(), "dense")


def test_models_that_do_not_meet_or_have_no_landmarks_are_refused() -> None:
    far = other_topology()
    far = replace(far, mean=far.mean * np.array([1, 1, 1.9], np.float32) + np.array([0, 0, 40], np.float32))
    bare = replace(small_head_model(), landmarks={})
    with pytest.raises(UsageError, match="small synthetic head: expected ibug68 landmarks"):
        find_transfer(bare, small_head_model(), "dense")
    tiny = replace(far, mean=far.mean * np.float32(0.2))
    with pytest.raises(UsageError, match=r"to meet, found .*--through landmarks"):
        find_transfer(tiny, small_head_model(), "dense")


def test_the_command_states_the_residual(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model_path = write_small_head(tmp_path / "small.h5")
    renamed = replace(stored_small_head(), name="twin")
    write_stored_model(renamed, tmp_path / "twin.h5")
    assert main(["sample", "--n", "5", "--out", str(tmp_path / "a.h5"), "--model", str(model_path)]) == 0
    table = replace(load_coefficients(tmp_path / "a.h5"), image_paths=("pictures/1.jpg", "", "", "", ""))
    save_coefficients(table, tmp_path / "a.h5")
    capsys.readouterr()
    out = tmp_path / "new" / "b.h5"
    arguments = ["--from", str(tmp_path / "a.h5"), "--to", str(tmp_path / "twin.h5"), "--out", str(out)]
    assert main(["coeffs", "retarget", *arguments, "--from-model", str(model_path)]) == 0
    assert "5 faces of small synthetic head -> twin" in capsys.readouterr().err
    assert load_coefficients(out).image_paths[0] == "../pictures/1.jpg"
    assert main(["coeffs", "retarget", *arguments]) == 2
    assert "give the former with --from-model" in capsys.readouterr().err


def test_the_builtin_model_takes_its_own_faces_over() -> None:
    model = builtin_model()
    twin = replace(model, sha256="3" * 64)
    table = sample_faces(model, 20, 0, 256)
    transferred, residual = transfer_table(table, model, twin, "dense")
    assert residual.mean_mm < 0.2
    np.testing.assert_allclose(landmark_pixels(twin, transferred), landmark_pixels(model, table), atol=1.0)
