"""What `light.glsl` and the shadow maps need to know about light: uniforms, textures, directions. Model frame."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from datagen.appearance.asset_files import open_asset
from datagen.appearance.light.environments import environment, environment_names, softened_panorama
from datagen.appearance.light.harmonics import N_HARMONICS, turned
from datagen.appearance.light.light_colour import LUMINANCE
from datagen.appearance.light.light_sources import GOBOS, MAX_LAMPS, Light, environment_from_camera
from datagen.appearance.scene import Texture, UniformValue
from pix2face.geometry.camera import Camera, nearest_weak_perspective
from pix2face.models.morphable_model import MorphableModel

MAX_PANORAMAS = 2  # as in light.glsl
# Each environment has a layer for each of these blurs: as smooth and as rough surfaces reflect it.
LAYER_ANGLES_RAD = (0.0, 0.16)
# Widths of shadow edges follow from the size of the lamp and this distance, about that of a nose from the cheek.
_SHADOW_REACH_MM = 22.0
_NARROWEST_EDGE_MM, _WIDEST_EDGE_MM = 1.2, 9.0


@lru_cache(maxsize=1)
def light_textures() -> Mapping[str, Texture]:
    """The environments without their lamps, in two degrees of softness each."""
    layers = []
    for name in environment_names():
        rest = environment(name).rest
        layers += [rest if angle == 0 else softened_panorama(rest, angle) for angle in LAYER_ANGLES_RAD]
    pixels = np.minimum(np.stack(layers), 60000).astype(np.float16)
    return {"light_panoramas": Texture(pixels=pixels, repeat=True, mipmaps=False)}


def light_uniforms(light: Light, camera: Camera) -> dict[str, UniformValue]:
    """Uniforms of `light.glsl`; directions are turned from the camera into the model frame."""
    model_from_camera = _model_from_camera(camera)
    ambient = turned(_ambient(light), model_from_camera)
    directions, colours = np.tile([0.0, 0.0, 1.0], (MAX_LAMPS, 1)), np.zeros((MAX_LAMPS, 3))
    sizes, edges = np.zeros(MAX_LAMPS), np.full(MAX_LAMPS, _NARROWEST_EDGE_MM)
    for place, lamp in enumerate(light.lamps):
        directions[place] = model_from_camera @ np.array(lamp.direction)
        colours[place] = lamp.colour
        sizes[place] = np.sin(lamp.radius_rad)
        edges[place] = np.clip(_SHADOW_REACH_MM * lamp.radius_rad, _NARROWEST_EDGE_MM, _WIDEST_EDGE_MM)
    return {
        "light_sh": ambient.astype(np.float32),
        "light_sky_share": _sky(light)[1],
        "light_direction": directions.astype(np.float32),
        "light_colour": colours.astype(np.float32),
        "light_size": sizes.astype(np.float32),
        "light_edge_mm": edges.astype(np.float32),
        **_panorama_uniforms(light, model_from_camera),
        **_gobo_uniforms(light, model_from_camera),
    }


def shadow_lights(light: Light, camera: Camera) -> Float32[ndarray, "3 3"]:
    """Towards the two lamps and the sky, unit vectors, model frame; a row of zeros where there is no lamp."""
    model_from_camera = _model_from_camera(camera)
    towards = np.zeros((MAX_LAMPS + 1, 3))
    for place, lamp in enumerate(light.lamps):
        towards[place] = lamp.direction
    towards[MAX_LAMPS] = _sky(light)[0]
    return np.asarray(towards @ model_from_camera.T, dtype=np.float32)


@lru_cache(maxsize=4)
def _model_from_camera(camera: Camera) -> Float64[ndarray, "3 3"]:
    turn = nearest_weak_perspective(camera).rotation.T
    turn.setflags(write=False)
    return turn


def _ambient(light: Light) -> Float64[ndarray, "9 3"]:
    return np.array(light.ambient).reshape(N_HARMONICS, 3)


def _sky(light: Light) -> tuple[Float64[ndarray, "3"], float]:
    """Where most ambient light comes from (camera frame), and the share of it that something there would block."""
    luminance = _ambient(light) @ LUMINANCE
    slope = luminance[1:4] / max(float(luminance[0]), 1e-9)
    strength = float(np.linalg.norm(slope))
    towards = slope + np.array([0.0, -0.35, -0.15])  # above and before the face, where nothing else is known
    return towards / np.linalg.norm(towards), float(np.clip(0.3 + 0.35 * strength, 0, 0.8))


def _panorama_uniforms(light: Light, model_from_camera: Float64[ndarray, "3 3"]) -> dict[str, UniformValue]:
    found: dict[str, UniformValue] = {"light_panorama_count": len(light.panoramas)}
    layers = np.zeros(MAX_PANORAMAS, dtype=np.int32)
    turns, matrices = np.zeros((2, MAX_PANORAMAS, 3, 3), dtype=np.float32)
    for place, panorama in enumerate(light.panoramas):
        layers[place] = environment_names().index(panorama.name) * len(LAYER_ANGLES_RAD)
        turns[place] = environment_from_camera(panorama) @ model_from_camera.T
        matrices[place] = panorama.colour_matrix
    return {**found, "light_panorama_layer": layers, "light_panorama_turn": turns, "light_panorama_matrix": matrices}


def _gobo_uniforms(light: Light, model_from_camera: Float64[ndarray, "3 3"]) -> dict[str, UniformValue]:
    """Uniforms of a gobo; its two axes lie in the plane across the first lamp's light, in periods per mm."""
    gobo = light.gobo
    if gobo is None:
        return {"light_gobo": 0}
    towards = np.array(light.lamps[0].direction)
    across = np.cross([0.0, 1.0, 0.0] if abs(towards[1]) < 0.9 else [1.0, 0.0, 0.0], towards)
    across /= np.linalg.norm(across)
    down = np.cross(towards, across)
    c, s = np.cos(gobo.turn_rad), np.sin(gobo.turn_rad)
    axes = np.stack([c * across + s * down, -s * across + c * down]) @ model_from_camera.T / gobo.period_mm
    return {
        "light_gobo": 1 + GOBOS.index(gobo.kind),
        "light_gobo_axes": axes.astype(np.float32),
        "light_gobo_shift": gobo.shift,
        "light_gobo_depth": gobo.depth,
        "light_gobo_edge": float(np.clip(2.5 * light.lamps[0].radius_rad, 0.04, 0.45)),
    }


def head_occlusion(model: MorphableModel) -> Float32[ndarray, " v"]:
    """How much ambient light arrives at each vertex: 1 in the open, 0 where it is enclosed.

    It is stored for the built-in model by `scripts/build_head_occlusion.py`; for other models it is 1. The inside of
    the mouth has the values of an open mouth, since nobody sees it in a closed one.
    """
    with open_asset("head_occlusion.h5") as file:
        stored = file["occlusion"][:]
        is_same = file.attrs["model_sha256"] == model.sha256 and len(stored) == len(model.mean)
    if not is_same:
        return np.ones(len(model.mean), dtype=np.float32)
    return np.asarray(stored.astype(np.float32) / 255)
