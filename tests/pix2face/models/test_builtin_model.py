"""The built-in model: that it is a head, in mm, in the frame, symmetric, and small."""

from importlib.resources import files

import numpy as np
import pytest

from pix2face.geometry.landmarks import IBUG68, IBUG68_2D, MIRROR_IBUG68
from pix2face.models.morphable_model import MorphableModel, builtin_model


@pytest.fixture(scope="module")
def model() -> MorphableModel:
    return builtin_model()


def test_sizes_are_what_the_docs_say(model: MorphableModel) -> None:
    assert (model.n_identity, model.n_expression, len(model.named_expressions)) == (80, 44, 52)
    assert 15_000 < len(model.mean) < 20_000
    assert len(builtin_model(2).mean) > 53_215  # BFM's density
    assert len(files("pix2face").joinpath("assets/builtin_model.h5").read_bytes()) < 4_000_000
    assert model.licence == "CC0-1.0"


def test_mean_is_mirror_symmetric_to_the_last_bit(model: MorphableModel) -> None:
    assert model.symmetry is not None
    np.testing.assert_array_equal(model.symmetry[model.symmetry], np.arange(len(model.mean)))
    np.testing.assert_array_equal(model.mean[model.symmetry], model.mean * np.float32([-1, 1, 1]))


def test_components_are_symmetric_or_antisymmetric(model: MorphableModel) -> None:
    assert model.symmetry is not None
    for component in model.identity_basis:
        mirrored = component[model.symmetry] * np.float32([-1, 1, 1])
        size = np.abs(component).max()
        assert min(np.abs(mirrored - component).max(), np.abs(mirrored + component).max()) < 1e-3 * size


def test_frame_and_scale_are_those_of_an_adult_head(model: MorphableModel) -> None:
    points = model.mean[model.landmarks[IBUG68]]
    eyes, nose, mouth, chin = points[[36, 45]], points[30], points[[48, 54]], points[8]
    assert 84 < np.linalg.norm(eyes[0] - eyes[1]) < 94
    assert eyes[1, 0] > 0 > eyes[0, 0]  # x to the subject's left, which is the picture's right
    assert eyes[:, 1].min() > mouth[:, 1].max() > chin[1]
    assert nose[2] == points[:, 2].max()
    assert 105 < points[27, 1] - chin[1] < 125  # bridge of the nose to chin
    assert model.smallest_radius_mm > 50
    assert np.abs(model.mean).max() < 150


@pytest.mark.parametrize("scheme", [IBUG68, IBUG68_2D])
def test_landmarks_mirror_each_other(model: MorphableModel, scheme: str) -> None:
    assert model.symmetry is not None
    landmarks = model.landmarks[scheme]
    np.testing.assert_array_equal(model.symmetry[landmarks], landmarks[np.array(MIRROR_IBUG68)])
    assert len(set(landmarks.tolist())) == 68


def test_landmarks_lie_on_the_face(model: MorphableModel) -> None:
    assert model.is_face_vertex[model.landmarks[IBUG68]].all()
    between = np.linalg.norm(model.mean[model.landmarks[IBUG68]] - model.mean[model.landmarks[IBUG68_2D]], axis=1)
    assert between.max() < 25  # mm; along the jaw
    assert np.median(between) < 5


def test_triangles_face_outward(model: MorphableModel) -> None:
    corners = model.mean[model.triangles].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    skin = model.triangle_regions == model.region_names.index("skin")
    outward = np.einsum("tc,tc->t", normals, corners.mean(axis=1)) > 0
    assert outward[skin].mean() > 0.9  # nose, nostrils and lids turn some the other way


def test_texture_coordinates_cover_every_triangle(model: MorphableModel) -> None:
    assert model.uv is not None
    assert model.uv_triangles is not None
    assert model.uv_triangles.shape == model.triangles.shape
    assert model.uv_triangles.max() < len(model.uv)
    assert (model.uv >= 0).all()
    assert (model.uv <= 1).all()


def test_every_region_is_there(model: MorphableModel) -> None:
    assert set(np.unique(model.triangle_regions)) == set(range(len(model.region_names)))
    assert "scalp" not in model.face_regions
    assert "neck" not in model.face_regions


def test_random_faces_stay_human(model: MorphableModel) -> None:
    rng = np.random.default_rng(0)
    faces = model.vertices(rng.standard_normal((200, model.n_identity)), np.zeros((200, model.n_expression)))
    landmarks = faces[:, model.landmarks[IBUG68]]
    eye_distance = np.linalg.norm(landmarks[:, 36] - landmarks[:, 45], axis=1)
    face_height = np.linalg.norm(landmarks[:, 27] - landmarks[:, 8], axis=1)
    assert 72 < eye_distance.min() < eye_distance.max() < 105
    assert 85 < face_height.min() < face_height.max() < 150
    # Noses stay in front of mouths, mouths below noses.
    assert (landmarks[:, 30, 2] > landmarks[:, 51, 2]).mean() > 0.95  # the tip of the nose lies before the lips
    assert (landmarks[:, 33, 1] > landmarks[:, 51, 1]).all()


@pytest.mark.parametrize(
    ("name", "landmark", "direction"),
    [
        ("jawOpen", 8, (0, -1, 0)),
        ("eyeBlinkLeft", 44, (0, -1, 0)),
        ("mouthSmileLeft", 54, (1, 1, 0)),
        ("browOuterUpRight", 18, (0, 1, 0)),
    ],
)
def test_named_expressions_do_what_they_say(
    model: MorphableModel, name: str, landmark: int, direction: tuple[int, int, int]
) -> None:
    """Left is the subject's left, as ARKit has it."""
    face = model.vertices(np.zeros((1, model.n_identity)), model.named_expressions[name][None])[0]
    moved = (face - model.mean)[model.landmarks[IBUG68]]
    assert moved[landmark] @ np.array(direction) > 3
    other_side = moved[MIRROR_IBUG68[landmark]]
    if MIRROR_IBUG68[landmark] != landmark:
        assert np.linalg.norm(other_side) < 0.3 * np.linalg.norm(moved[landmark])
