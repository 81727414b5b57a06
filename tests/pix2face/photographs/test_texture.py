"""Colours of a mesh are those that its photograph shows where it is seen, and no others' where it is hidden."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy import ndarray
from scipy.spatial.distance import cdist

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.fitting.face_fit import FaceFit, face_of_coefficients
from pix2face.geometry.camera import Camera, HeadPose, Pinhole, pinhole_camera, rotation_of_pose
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import interpolate, rasterise
from pix2face.models.surface_attributes import facing
from pix2face.photographs.texture import BORDER_FADE_MM, MIDDLE_MM, NO_COLOUR, face_texture, vertex_colours
from tests.cameras import posed_camera
from tests.synthetic_models import small_head_model
from tests.textured_head import textured_head

MODEL, TEXTURED = small_head_model(), textured_head()
HEIGHT_PX, WIDTH_PX = 400, 420
BACKGROUND = (0, 255, 0)  # no colour of the face: it must not show up on it

Paint = Callable[[ndarray], ndarray]


def fitted(model: MorphableModel, camera: Camera, seed: int = 3) -> FaceFit:
    rng = np.random.default_rng(seed)
    identity, expression = rng.normal(size=model.n_identity), rng.normal(size=model.n_expression)
    return face_of_coefficients(model, camera, identity, expression)


def turned(yaw_deg: float, centre: tuple[float, float] = (210.0, 200.0), scale: float = 1.5) -> Camera:
    return posed_camera(*centre, yaw_deg=yaw_deg, scale=scale)


def photograph(fit: FaceFit, paint: Paint) -> ndarray:
    """The whole head painted by where its points are on the mean face, before the background."""
    seen = rasterise(fit.camera.matrix, fit.vertices, fit.model.triangles, HEIGHT_PX, WIDTH_PX)
    head = seen.triangle >= 0
    image = np.broadcast_to(np.array(BACKGROUND, dtype=np.uint8), (HEIGHT_PX, WIDTH_PX, 3)).copy()
    places = interpolate(seen, fit.model.mean, fit.model.triangles)[head]
    image[head] = np.clip(np.rint(paint(places)), 0, 255).astype(np.uint8)
    return image


def gradual(points: ndarray) -> ndarray:
    """Grows with x, y and z."""
    return np.stack([128 + points[:, 0] * 0.8, 128 + points[:, 1] * 0.8, 110 + points[:, 2] * 0.8], axis=1)


def symmetric(points: ndarray) -> ndarray:
    return gradual(np.abs(points[:, :1]) * [1, 0, 0] + points * [0, 1, 1])


def inside(model: MorphableModel) -> ndarray:
    """Face vertices so far from scalp and neck that no colour fades there."""
    beyond = cdist(model.mean, model.mean[np.unique(model.triangles[~model.is_face_triangle])]).min(axis=1)
    return model.is_face_vertex & (beyond > BORDER_FADE_MM)


def well_seen(fit: FaceFit, from_cosine: float = 0.6) -> ndarray:
    """Vertices inside the face that turn to the viewer and have nothing before them."""
    model = fit.model
    depth = rasterise(fit.camera.matrix, fit.vertices, model.triangles, HEIGHT_PX, WIDTH_PX).depth
    columns, rows = np.floor(fit.camera.project(fit.vertices.astype(float))).astype(int).T
    in_picture = (columns >= 0) & (rows >= 0) & (columns < WIDTH_PX) & (rows < HEIGHT_PX)
    nearest = depth[np.clip(rows, 0, HEIGHT_PX - 1), np.clip(columns, 0, WIDTH_PX - 1)]
    near = fit.camera.depth(fit.vertices.astype(float)) <= nearest + 1
    return in_picture & near & inside(model) & (facing(fit.vertices, model.triangles, fit.camera) > from_cosine)


def near_pinhole() -> Camera:
    rotation = rotation_of_pose(HeadPose(5, 20, 0))
    return pinhole_camera(Pinhole(900.0, np.array([200.0, 200.0]), rotation, np.array([5.0, 0.0, 600.0])))


@pytest.mark.parametrize("camera", [turned(0), turned(35), turned(-60), near_pinhole()])
def test_seen_vertices_have_the_colour_that_the_photograph_shows(camera: Camera) -> None:
    fit = fitted(MODEL, camera)
    found = vertex_colours(photograph(fit, gradual), fit, MODEL)
    seen = well_seen(fit)
    assert seen.sum() > 200
    error = np.abs(found[seen] - gradual(MODEL.mean[seen])).max(axis=1)
    assert np.mean(error < 4) > 0.97
    assert np.median(error) < 1.5


def zigzag(positions: ndarray) -> ndarray:
    """From 0 to 255 and back within 16 pixels: a shift of a tenth of a pixel is a change of three."""
    return np.asarray(255 * np.abs((positions / 8) % 2 - 1))


def test_vertices_have_the_colour_of_the_very_place_that_they_are_projected_to() -> None:
    fit = fitted(MODEL, turned(10))
    columns, rows = np.meshgrid(np.arange(WIDTH_PX) + 0.5, np.arange(HEIGHT_PX) + 0.5)
    image = np.stack([zigzag(columns), zigzag(rows), np.full_like(rows, 128)], axis=2).astype(np.uint8)
    seen = well_seen(fit)
    expected = zigzag(fit.camera.project(fit.vertices.astype(float)))[seen]
    error = vertex_colours(image, fit, MODEL)[seen, :2] - expected
    assert np.abs(np.median(error, axis=0)).max() < 3
    assert np.median(np.abs(error)) < 1.5


def test_hidden_vertices_take_the_colour_of_their_mirror_image() -> None:
    fit = fitted(MODEL, turned(45))
    found = vertex_colours(photograph(fit, symmetric), fit, MODEL)
    assert MODEL.symmetry is not None
    hidden = facing(fit.vertices, MODEL.triangles, fit.camera) < 0
    known = hidden & well_seen(fit)[MODEL.symmetry]
    assert known.sum() > 100
    error = np.abs(found[known] - symmetric(MODEL.mean[known])).max(axis=1)
    assert np.mean(error < 4) > 0.94  # beside steps, such as an ear's, nothing is taken from the photograph


def test_what_hides_another_part_does_not_colour_it() -> None:
    """A red nose before a blue face, from the side: no red on the cheek that it hides, even without symmetry."""

    def nose(points: ndarray) -> ndarray:
        return (points[:, 2] > 102) & (np.abs(points[:, 0]) < 25)

    def red_nose(points: ndarray) -> ndarray:
        return np.where(nose(points)[:, None], [250, 0, 0], [0, 0, 250])

    model = replace(MODEL, symmetry=None)
    fit = fitted(model, turned(55))
    found = vertex_colours(photograph(fit, red_nose), fit, model).astype(int)
    is_red, is_nose = found[:, 0] - found[:, 2] > 100, nose(model.mean)
    near_nose = (model.mean[:, 2] > 97) & (np.abs(model.mean[:, 0]) < 30)
    assert is_red[is_nose & well_seen(fit)].mean() > 0.8
    assert not is_red[~near_nose].any()


@pytest.mark.parametrize("yaw_deg", [0.0, 40.0, 75.0])
def test_the_background_does_not_colour_the_face(yaw_deg: float) -> None:
    fit = fitted(MODEL, turned(yaw_deg))
    found = vertex_colours(photograph(fit, lambda points: np.full_like(points, 90)), fit, MODEL).astype(int)
    assert np.mean(np.abs(found - 90).max(axis=1) < 3) > 0.995


def test_what_is_not_face_has_the_median_colour_around_the_nose() -> None:
    fit = fitted(MODEL, turned(20))
    found = vertex_colours(photograph(fit, gradual), fit, MODEL)
    beyond = found[~MODEL.is_face_vertex]
    assert len(np.unique(beyond, axis=0)) == 1
    nose = MODEL.mean[MODEL.landmarks["ibug68"][30]]
    seen = well_seen(fit, 0.3) & (np.linalg.norm(MODEL.mean - nose, axis=1) < MIDDLE_MM)
    assert np.abs(beyond[0] - np.median(gradual(MODEL.mean[seen]), axis=0)).max() < 10


def test_colours_fade_towards_scalp_and_neck() -> None:
    """A bright face under dark hair: no edge where the face of the model ends, wherever the hair begins."""
    fit = fitted(MODEL, turned(0))

    def dark_hair(points: ndarray) -> ndarray:
        return np.where(points[:, 1:2] > 40, 20.0, 200.0) * np.ones(3)

    found = vertex_colours(photograph(fit, dark_hair), fit, MODEL).astype(float)[:, 0]
    edges = MODEL.triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
    edges = edges[(MODEL.mean[edges, 1] > 55).all(axis=1)]
    edges = edges[MODEL.is_face_vertex[edges].any(axis=1) & ~MODEL.is_face_vertex[edges].all(axis=1)]
    assert len(edges) > 10
    assert np.abs(np.diff(found[edges], axis=1)).max() < 60
    assert found[~MODEL.is_face_vertex].min() > 190


@pytest.mark.parametrize(("brightness", "expected"), [(30, 200), (180, 180)])
def test_ears_as_dark_as_hair_have_the_colour_of_the_skin(brightness: int, expected: int) -> None:
    ears = np.zeros(len(MODEL.mean), dtype=bool)
    ears[MODEL.triangles[MODEL.triangle_regions == MODEL.region_names.index("ears")]] = True
    fit = fitted(MODEL, turned(60))

    def beside_the_face(points: ndarray) -> ndarray:
        return np.where(points[:, 2:] < 30, brightness, 200) * np.ones(3)

    found = vertex_colours(photograph(fit, beside_the_face), fit, MODEL).astype(float)
    seen = ears & well_seen(fit)
    assert seen.sum() > 5
    assert np.abs(found[seen] - expected).max() < 25


def test_a_face_cut_by_the_border_takes_nothing_from_beyond_it() -> None:
    fit = fitted(MODEL, turned(0, (10.0, 200.0)))
    found = vertex_colours(photograph(fit, symmetric), fit, MODEL)
    outside = inside(MODEL) & (fit.camera.project(fit.vertices.astype(float))[:, 0] < 0)
    frontal = facing(fit.vertices, MODEL.triangles, fit.camera) > 0.6
    assert (outside & frontal).sum() > 50
    error = np.abs(found - symmetric(MODEL.mean)).max(axis=1)
    assert np.mean(error[outside & frontal] < 5) > 0.9  # from the other half of the face


def test_a_face_beside_the_photograph_is_grey() -> None:
    fit = fitted(MODEL, turned(0, (-500.0, 200.0)))
    assert (vertex_colours(photograph(fit, gradual), fit, MODEL) == NO_COLOUR).all()


@pytest.mark.parametrize("yaw_deg", [0.0, -40.0])
def test_texels_have_the_colours_of_their_points(yaw_deg: float) -> None:
    fit = fitted(TEXTURED, turned(yaw_deg))
    size = 512
    texture = face_texture(photograph(fit, symmetric), fit, TEXTURED, size)
    assert texture.shape == (size, size, 3)
    assert TEXTURED.uv is not None
    front = TEXTURED.uv[: len(TEXTURED.mean)]
    columns, rows = (np.stack([front[:, 0], 1 - front[:, 1]], axis=1) * size).astype(int).T
    seen = well_seen(fit) & (TEXTURED.mean[:, 2] > 20)
    error = np.abs(texture[rows, columns][seen] - symmetric(TEXTURED.mean[seen])).max(axis=1)
    assert seen.sum() > 200
    assert np.mean(error < 6) > 0.95


def test_a_texture_is_as_fine_as_the_face_in_it_needs() -> None:
    fit = fitted(TEXTURED, turned(0))
    assert TEXTURED.uv is not None
    for scale, size in ((1.0, 1024), (0.25, 4096)):
        model = replace(TEXTURED, uv=TEXTURED.uv * np.float32(scale))
        assert face_texture(np.zeros((8, 8, 3), np.uint8), fit, model).shape == (size, size, 3)


@pytest.mark.parametrize(("enlargement", "size"), [(1, 1024), (4, 2048)])
def test_a_large_photograph_has_a_fine_texture(enlargement: int, size: int) -> None:
    fit = fitted(TEXTURED, turned(0)).transformed(np.diag([enlargement, enlargement, 1.0]))
    stripes = np.where(np.arange(400 * enlargement) % 4 < 2, 60, 200).astype(np.uint8)
    texture = face_texture(np.tile(stripes[:, None, None], (1, len(stripes), 3)), fit, TEXTURED)
    assert texture.shape == (size, size, 3)
    assert np.quantile(texture, 0.99) - np.quantile(texture, 0.01) > 80  # the stripes are not blurred


def test_texture_coordinates_beside_the_texture_leave_it_plain() -> None:
    assert TEXTURED.uv is not None
    model = replace(TEXTURED, uv=TEXTURED.uv + np.float32(5))
    fit = fitted(model, turned(0))
    assert (face_texture(photograph(fit, lambda points: np.full_like(points, 90)), fit, model, 64) == 90).all()


def test_islands_of_the_texture_are_padded() -> None:
    fit = fitted(TEXTURED, turned(0))
    texture = face_texture(photograph(fit, lambda points: np.full_like(points, 90)), fit, TEXTURED, 256)
    assert np.abs(texture.astype(int) - 90).max() <= 2


def test_a_model_without_texture_coordinates_is_named() -> None:
    fit = fitted(MODEL, turned(0))
    with pytest.raises(UsageError, match=r"small synthetic head.*vertex colours"):
        face_texture(photograph(fit, gradual), fit, MODEL)


def test_a_face_without_extent_is_refused() -> None:
    fit = replace(fitted(MODEL, turned(0)), camera=turned(0, scale=0.0))
    with pytest.raises(DegenerateGeometryError, match="face box"):
        vertex_colours(np.zeros((9, 9, 3), dtype=np.uint8), fit, MODEL)
