"""light.glsl against the same formulas in NumPy, and against what energy allows."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import moderngl
import numpy as np
import pytest

from datagen.appearance.light.environments import environment, environment_names
from datagen.appearance.light.harmonics import fibonacci_sphere, white_surface
from datagen.appearance.light.light import draw_light
from datagen.appearance.light.light_config import LightConfig
from datagen.appearance.light.light_sources import Gobo, Lamplight, Light, PanoramaLight, environment_from_camera
from datagen.appearance.light.shading import light_textures, light_uniforms, shadow_lights
from datagen.opengl.gl_context import GLContext
from datagen.rendering.gl_mesh import shader_source
from datagen.rendering.scenes.scene_program import SceneTextures
from datagen.rendering.scenes.scene_shadows import ShadowMaps
from pix2face.geometry.camera import WeakPerspective, weak_perspective_camera

pytestmark = pytest.mark.gl

CAMERA = weak_perspective_camera(WeakPerspective(1.0, np.diag([1.0, -1.0, -1.0]), np.zeros(2)))
MODEL_FROM_CAMERA = np.diag([1.0, -1.0, -1.0])
SIDE = 16
NORMALS = fibonacci_sphere(SIDE * SIDE)
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
MAIN = """
uniform sampler2D normals;
uniform vec3 albedo, tangent, view;
uniform float roughness, reflectance, scatter, occlusion;
uniform bool is_mirror;
layout(location = 0) out vec4 shown;
void main() {
    vec4 given = texelFetch(normals, ivec2(gl_FragCoord.xy), 0);
    Surface s;
    s.position = vec3(gl_FragCoord.xy, 0.0);
    s.smooth_normal = s.normal = given.xyz;
    s.tangent = tangent;
    s.albedo = albedo;
    s.alpha = 1.0;
    s.roughness = roughness;
    s.reflectance = reflectance;
    s.scatter = scatter;
    s.occlusion = occlusion;
    vec3 towards_camera = dot(view, view) > 0.0 ? view : given.xyz;
    shown = vec4(is_mirror ? mirrored(given.xyz) : light(s, towards_camera), 1.0);
}
"""
Show = Callable[..., np.ndarray]


def set_uniforms(program: moderngl.Program, values: Mapping[str, object]) -> None:
    """Matrices are given row by row; what the program does not have is of others."""
    for name, value in values.items():
        found = program.get(name, None)
        if isinstance(found, moderngl.Uniform):
            numbers = np.asarray(value, dtype={"f": np.float32, "i": np.int32}[found.fmt[-1]])
            numbers = np.swapaxes(numbers, -1, -2) if found.matrix else numbers
            found.write(np.ascontiguousarray(numbers).tobytes()[: 4 * found.array_length * found.dimension])


@pytest.fixture(scope="module")
def show(gl_session: GLContext) -> Show:
    """What surfaces of all normals show in a light, seen from straight above each of them."""
    context = gl_session.context
    gl_session.make_current()
    program = context.program(
        vertex_shader=shader_source(330, "whole_vertex"),
        fragment_shader=shader_source(330, "colour", "surface", "shadow", "lamps", "light") + MAIN,
    )
    shadows, textures = ShadowMaps(context, 0), SceneTextures(light_textures(), context)
    given = context.texture((SIDE, SIDE), 4, np.c_[NORMALS, np.zeros(SIDE * SIDE)].astype(np.float32), dtype="f4")
    given.filter = (moderngl.NEAREST, moderngl.NEAREST)
    target = context.framebuffer([context.renderbuffer((SIDE, SIDE), 4, dtype="f4")])
    triangle = context.vertex_array(program, [])

    def draw(light: Light, **surface: object) -> np.ndarray:
        defaults = {"albedo": (1.0, 1.0, 1.0), "tangent": (0.0, 0.0, 0.0), "view": (0.0, 0.0, 0.0), "is_mirror": False}
        numbers = {"roughness": 1.0, "reflectance": 0.0, "scatter": 0.0, "occlusion": 1.0}
        ball = (80 * fibonacci_sphere(50)).astype(np.float32)
        of_shadows = shadows.draw(ball, shadow_lights(light, CAMERA), lambda which: [], lambda view, towards: None)
        set_uniforms(program, {**light_uniforms(light, CAMERA), **of_shadows, **textures.units, "normals": 1})
        set_uniforms(program, {**defaults, **numbers, **surface})
        textures.bind()
        given.use(1)
        target.use()
        target.clear()
        context.enable_only(moderngl.NOTHING)
        triangle.render(moderngl.TRIANGLES, vertices=3)
        pixels = np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(-1, 4)
        assert context.error == "GL_NO_ERROR"
        assert np.isfinite(pixels).all()
        return pixels[:, :3].astype(np.float64)

    return draw


def even_light(level: float = 1.0) -> Light:
    ambient = np.zeros((9, 3))
    ambient[0] = level
    return Light(
        kind="soft",
        setup="even",
        illuminance=level,
        key_share=0,
        key_azimuth_deg=0,
        key_elevation_deg=0,
        lamps=(),
        panoramas=(),
        ambient=tuple(ambient.reshape(-1).tolist()),
        gobo=None,
    )


def one_lamp(direction: tuple[float, float, float], radius: float = 0.02, colour=(1.0, 0.8, 0.6)) -> Light:
    return replace(even_light(0.0), lamps=(Lamplight(direction=direction, colour=colour, radius_rad=radius),))


def test_in_even_light_a_white_surface_shows_the_light(show: Show) -> None:
    np.testing.assert_allclose(show(even_light(0.7)), 0.7, rtol=1e-3)
    # With a coat that mirrors, nothing is darker, and no more comes back than one coat's mirror adds.
    coated = show(even_light(0.7), reflectance=0.04, roughness=0.5)
    assert (coated >= 0.7 - 1e-6).all()
    assert coated.max() < 0.7 * 1.15


@pytest.mark.parametrize("seed", range(6))
def test_ambient_light_is_that_of_the_harmonics(show: Show, seed: int) -> None:
    light = replace(draw_light(np.random.default_rng(seed), LightConfig()), lamps=(), gobo=None)
    in_camera = NORMALS @ MODEL_FROM_CAMERA
    exact = white_surface(np.array(light.ambient).reshape(9, 3), in_camera)
    np.testing.assert_allclose(show(light), exact, rtol=2e-3, atol=2e-4)


@pytest.mark.parametrize("direction", [(0.0, 0.0, -1.0), (0.6, -0.8, 0.0), (-0.48, 0.6, -0.64)])
def test_a_lamp_lights_what_faces_it_by_the_cosine(show: Show, direction: tuple[float, float, float]) -> None:
    light = one_lamp(direction)
    cosine = np.maximum(NORMALS @ MODEL_FROM_CAMERA @ np.array(direction), 0)
    np.testing.assert_allclose(show(light), cosine[:, None] * [1.0, 0.8, 0.6], atol=2e-5)
    # Half the colour, half the light.
    np.testing.assert_allclose(show(light, albedo=(0.5, 0.5, 0.5)), 0.5 * show(light), atol=1e-5)


def test_skin_reddens_where_the_light_ends_and_keeps_its_energy(show: Show) -> None:
    light = one_lamp((0.0, 0.0, -1.0), colour=(1.0, 1.0, 1.0))
    skin, cosine = show(light, scatter=1.0), NORMALS[:, 2]
    at_edge = np.abs(cosine) < 0.1
    assert (skin[at_edge, 0] > skin[at_edge, 2] + 0.01).all()
    assert skin[cosine > 0.9].min() > 0.7
    # Over the whole ball as much light comes back in each colour as without scattering: 1/4.
    np.testing.assert_allclose(skin.mean(axis=0), 0.25, rtol=0.02)


def test_thin_parts_shine_red_with_light_from_behind(show: Show) -> None:
    behind = show(one_lamp((0.0, 0.0, 1.0), colour=(1.0, 1.0, 1.0)), scatter=2.0)
    thick = show(one_lamp((0.0, 0.0, 1.0), colour=(1.0, 1.0, 1.0)), scatter=1.0)
    facing = NORMALS[:, 2] > 0.9  # the camera, not the lamp
    assert thick[facing].max() < 1e-3
    assert behind[facing, 0].min() > 0.3
    assert (behind[facing, 0] > 3 * behind[facing, 2]).all()


@pytest.mark.parametrize("roughness", [0.15, 0.3, 0.5, 0.8])
@pytest.mark.parametrize("radius", [0.01, 0.2, 0.4])
def test_a_highlight_returns_no_more_than_arrives_and_is_where_the_mirror_says(
    show: Show, roughness: float, radius: float
) -> None:
    towards = np.array([0.0, 0.0, 1.0])
    light = one_lamp((0.0, 0.0, -1.0), radius, (1.0, 1.0, 1.0))
    shown = show(light, albedo=(0.0, 0.0, 0.0), reflectance=0.04, roughness=roughness, view=tuple(towards))
    assert NORMALS[shown[:, 0].argmax()] @ towards > 0.95
    # All normals of a ball, weighted as they look: at most the Fresnel share of what arrives there, with the margin
    # of a lobe that is sampled by 256 normals and a lamp that is one point for all of its disc.
    front = NORMALS[:, 2] > 0
    returned = np.average(shown[front, 0], weights=NORMALS[front, 2])
    assert 0.0 < returned < 0.12


def test_rough_surfaces_mirror_less_at_the_middle_of_a_highlight(show: Show) -> None:
    light = one_lamp((0.0, 0.0, -1.0))
    peaks = [
        show(light, albedo=(0.0, 0.0, 0.0), reflectance=0.04, roughness=r, view=(0.0, 0.0, 1.0)).max()
        for r in (0.4, 0.5, 0.65, 0.9)
    ]
    assert (np.diff(peaks) < 0).all()


def test_hair_shines_across_its_strands(show: Show) -> None:
    """Seen and lit from the front, strands that run up shine for all normals in a band across, the rest does not."""
    light = one_lamp((0.0, 0.0, -1.0))
    surface = {"albedo": (0.1, 0.06, 0.03), "reflectance": 0.04, "roughness": 0.3, "view": (0.0, 0.0, 1.0)}
    upright = show(light, tangent=(0.0, 1.0, 0.0), **surface)
    along_view = show(light, tangent=(0.0, 0.3, 0.954), **surface)
    facing = NORMALS[:, 2] > 0.7
    assert upright[facing].mean() > along_view[facing].mean() + 0.02


def test_mirrors_show_the_environment_where_it_is(show: Show) -> None:
    """Against a look into the panorama itself, lamps taken out."""
    panorama = PanoramaLight(name="venice", heading_deg=70.0, tilt_deg=8.0, roll_deg=-4.0, colour_matrix=IDENTITY)
    light = replace(even_light(0.0), panoramas=(panorama,))
    shown = show(light, is_mirror=True)
    directions = NORMALS @ MODEL_FROM_CAMERA @ environment_from_camera(panorama).T
    rest = environment("venice").rest
    azimuth = (np.arctan2(directions[:, 0], directions[:, 2]) / (2 * np.pi) + 0.5) * 128
    row = np.arccos(np.clip(-directions[:, 1], -1, 1)) / np.pi * 64
    exact = rest[np.minimum(row, 63).astype(int), azimuth.astype(int) % 128]
    error = np.abs(shown - exact).mean() / exact.mean()
    assert error < 0.15
    assert np.corrcoef(shown[:, 0], exact[:, 0])[0, 1] > 0.95
    assert environment_names()  # the layer looked up is that of the name: another one does not correlate
    other = environment("forest").rest[np.minimum(row, 63).astype(int), azimuth.astype(int) % 128]
    assert np.abs(shown - other).mean() / exact.mean() > 2 * error


def test_mirrors_show_lamps(show: Show) -> None:
    shown = show(one_lamp((0.0, 0.0, -1.0), radius=0.3, colour=(0.5, 0.5, 0.5)), is_mirror=True)
    inside = np.arccos(np.clip(NORMALS[:, 2], -1, 1)) < 0.25
    outside = np.arccos(np.clip(NORMALS[:, 2], -1, 1)) > 0.35
    assert shown[inside].min() > 1
    assert shown[outside].max() < 0.01


@pytest.mark.parametrize("kind", ["blinds", "leaves", "bars"])
def test_patterns_take_light_away_in_patches(show: Show, kind: str) -> None:
    lamp = one_lamp((0.0, 0.0, -1.0), radius=0.01, colour=(1.0, 1.0, 1.0))
    gobo = Gobo(kind=kind, period_mm=7.0, turn_rad=0.3, shift=(0.2, 0.1), depth=0.9)
    lit = np.clip(NORMALS[:, 2], 1e-9, None)
    shares = (show(replace(lamp, gobo=gobo))[:, 0] / lit)[NORMALS[:, 2] > 0.2]
    assert shares.min() < 0.35
    assert shares.max() > 0.9
    assert ((shares > 0.05) & (shares < 1.01)).all()
    assert 0.15 < (shares > 0.5).mean() < 0.9


def test_the_same_light_is_drawn_twice_alike(show: Show) -> None:
    light = draw_light(np.random.default_rng(11), LightConfig())
    surface = {"reflectance": 0.04, "roughness": 0.2, "scatter": 1.0, "view": (0.0, 0.0, 1.0)}
    np.testing.assert_array_equal(show(light, **surface), show(light, **surface))
