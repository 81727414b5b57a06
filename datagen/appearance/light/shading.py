"""Uniforms and textures of `light.glsl`, and directions of the shadow maps, in the model frame."""

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
# Each environment has a texture layer for each of these blurs, for reflections of smooth and rough surfaces.
LAYER_ANGLES_RAD = (0.0, 0.16)
# The width of shadow edges is the lamp's angular radius times this distance, about that of the nose from the cheek.
_SHADOW_REACH_MM = 22.0
_NARROWEST_EDGE_MM, _WIDEST_EDGE_MM = 1.2, 9.0


@lru_cache(maxsize=1)
def light_textures() -> Mapping[str, Texture]:
    """Returns the texture of the environments without their lamps, each with the blurs of `LAYER_ANGLES_RAD`."""
    layers = []
    for name in environment_names():
        rest = environment(name).rest
        layers += [rest if angle == 0 else softened_panorama(rest, angle) for angle in LAYER_ANGLES_RAD]
    pixels = np.minimum(np.stack(layers), 60000).astype(np.float16)
    return {"light_panoramas": Texture(pixels=pixels, repeat=True, mipmaps=False)}


def light_uniforms(light: Light, camera: Camera) -> dict[str, UniformValue]:
    """Returns the uniforms of `light.glsl`, with directions in the model frame."""
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
    """Returns unit vectors to the two lamps and to the sky, in the model frame; rows without a lamp are 0."""
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
    """Returns the main direction of the ambient light (camera frame), and the share that an object there blocks."""
    luminance = _ambient(light) @ LUMINANCE
    slope = luminance[1:4] / max(float(luminance[0]), 1e-9)
    strength = float(np.linalg.norm(slope))
    towards = slope + np.array([0.0, -0.35, -0.15])  # biased to a place above and in front of the face
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
    """Returns the uniforms of a gobo. Its axes, in periods per mm, are perpendicular to the light of the first lamp."""
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
    """Returns the share of ambient light that reaches each vertex: 1 if it is exposed, 0 if it is enclosed.

    `scripts/build_head_occlusion.py` computes it for the built-in model; for other models it is 1. The inside of the
    mouth has the values of an open mouth, since it is invisible in a closed one.
    """
    with open_asset("head_occlusion.h5") as file:
        stored = file["occlusion"][:]
        is_same = file.attrs["model_sha256"] == model.sha256 and len(stored) == len(model.mean)
    if not is_same:
        return np.ones(len(model.mean), dtype=np.float32)
    return np.asarray(stored.astype(np.float32) / 255)
