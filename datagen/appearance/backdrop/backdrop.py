"""Backdrops: the environment that lights the head, another one, patterns, one colour, or the user's pictures."""

from dataclasses import dataclass
from typing import Any, final

import cv2
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from datagen.appearance.backdrop.backdrop_config import BackdropConfig
from datagen.appearance.backdrop.patterns import PATTERNS, draw_pattern
from datagen.appearance.backdrop.picture_folder import list_pictures, read_crop
from datagen.appearance.light.environment_light import scaled_panorama
from datagen.appearance.light.environments import environment, environment_names, panorama_view
from datagen.appearance.light.light_colour import LUMINANCE
from datagen.appearance.light.light_sources import Light, PanoramaLight
from datagen.appearance.photograph.lens import defocused
from datagen.random_streams import Triple, rounded, weighted_choice
from pix2face.errors import UsageError
from pix2face.files.images import srgb_to_linear
from pix2face.geometry.camera import Camera

ENVIRONMENTS = ("environment", "other environment")
_PLAIN = {  # sRGB
    "white": (1.0, 1.0, 1.0),
    "black": (0.0, 0.0, 0.0),
    "grey": (0.5, 0.5, 0.5),
    "green screen": (0.1, 0.69, 0.2),
    "blue screen": (0.05, 0.2, 0.7),
}
_IDENTITY: tuple[Triple, Triple, Triple] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
# Linear light of each sRGB byte.
_LINEAR = srgb_to_linear(np.arange(256) / 255).astype(np.float32)


@final
@dataclass(frozen=True, kw_only=True)
class PersonPlace:
    """The place of another person behind the head."""

    x: float  # centre of the head, as a share of the picture's width
    y: float  # centre of the head, as a share of the picture's height
    scale: float  # size of the head relative to the one in front
    blur: float  # radius of the defocus blur, as a share of the picture's width
    seed: int  # of the person's appearance


@final
@dataclass(frozen=True, kw_only=True)
class Backdrop:
    """The backdrop of one picture."""

    kind: str  # `environment` (that of the light), `other environment`, `photograph`, `plain`, or a pattern's name
    seed: int = 0  # of the pattern
    panoramas: tuple[PanoramaLight, ...] = ()  # only for environments
    view_deg: float = 0.0  # angle of view of an environment across the picture; 0 is that of the camera
    colour: Triple = (0.5, 0.5, 0.5)  # only for `plain`; sRGB, 0..1
    level: float = 1.0  # factor on the light of anything but environments
    blur: float = 0.0  # radius of the defocus blur, as a share of the picture's width
    file: str = ""  # only for photographs; relative to the folder
    crop: Triple = (0.0, 0.0, 1.0)  # only for photographs; see `picture_folder.read_crop`
    is_mirrored: bool = False  # only for photographs
    people: tuple[PersonPlace, ...] = ()  # other people behind
    n_people: int = 0  # number of other people, stored with samples for filters


def draw_backdrop(rng: np.random.Generator, config: BackdropConfig, light: Light) -> Backdrop:
    """Draws a backdrop that suits the light.

    Raises:
        InputFileError: The folder of pictures does not exist, or has no readable pictures.
    """
    config.check()
    kind = _draw_kind(rng, config, light)
    people = _draw_people(rng, config)
    shown: dict[str, Any] = {}
    if kind in ENVIRONMENTS:
        shown["panoramas"] = _draw_panoramas(rng, kind, light)
        if rng.uniform() < config.widened_share:
            shown["view_deg"] = rounded(rng.uniform(25, max(26.0, config.widest_view_deg)), 2)
    elif kind == "photograph":
        names = list_pictures(config.folder)
        shown["file"] = names[int(rng.integers(len(names)))]
        shown["crop"] = (*rng.uniform(0, 1, size=2).round(4).tolist(), rounded(rng.uniform(0.3, 1), 4))
        shown["is_mirrored"] = bool(rng.uniform() < 0.5)
    elif kind == "plain":
        name = str(rng.choice([*_PLAIN, "any"]))
        shown["colour"] = _PLAIN.get(name) or tuple(rng.uniform(0, 1, size=3).round(4).tolist())
    is_sharp = rng.uniform() < config.sharp_share
    return Backdrop(
        kind=kind,
        seed=int(rng.integers(2**31)),
        level=_draw_level(rng, config, light, is_plain=kind == "plain"),
        blur=0.0 if is_sharp else rounded(np.exp(rng.uniform(*np.log(config.blur))), 5),
        people=people,
        n_people=len(people),
        **shown,
    )


def backdrop_pixels(
    backdrop: Backdrop, camera: Camera, height: int, width: int, folder: str = ""
) -> Float32[ndarray, "h w 3"]:
    """Renders a backdrop in linear light, where 1 is white.

    Environments are seen with the focal length and principal point of the camera. `folder` is the one in the
    `BackdropConfig`, since samples store only the name of a file in it.

    Raises:
        InputFileError: A photograph is missing or damaged.
        UsageError: The backdrop is a photograph and `folder` is empty.
    """
    radius = backdrop.blur * width
    if backdrop.kind in ENVIRONMENTS:
        view = panorama_view(backdrop.panoramas, camera, (height, width), backdrop.view_deg)
        soft = defocused(view, radius * view.shape[1] / width)
        return np.maximum(cv2.resize(soft, (width, height), interpolation=cv2.INTER_CUBIC), 0).astype(np.float32)
    if backdrop.kind == "plain":
        colour = _LINEAR[np.rint(255 * np.array(backdrop.colour)).astype(int)]
        return np.broadcast_to(colour * np.float32(backdrop.level), (height, width, 3)).copy()
    if backdrop.kind == "photograph":
        if not folder:
            raise UsageError(f"backdrop: expected the folder that holds {backdrop.file!r}, found none; name it again")
        drawn = read_crop(folder, backdrop.file, backdrop.crop, height, width)
        drawn = drawn[:, ::-1] if backdrop.is_mirrored else drawn
    else:
        drawn = draw_pattern(backdrop.kind, backdrop.seed, height, width)
    return defocused(_LINEAR[drawn] * np.float32(backdrop.level), radius)


def _draw_kind(rng: np.random.Generator, config: BackdropConfig, light: Light) -> str:
    if config.folder and rng.uniform() < config.folder_share:
        return "photograph"
    same, other = config.same_environment_weight, config.other_environment_weight
    if not light.panoramas:  # only lamps
        same = 0.0
    elif light.kind in ("backlit", "silhouette"):  # shows the light behind the head
        same *= 3
    weights = {"environment": same, "other environment": other}
    weights |= {"plain": config.plain_weight, "pattern": config.pattern_weight}
    if not sum(weights.values()) > 0:
        weights["other environment"] = 1.0
    kind = weighted_choice(rng, weights)
    if kind != "pattern":
        return kind
    if light.kind == "night" and rng.uniform() < 0.5:
        return "lights"
    return sorted(PATTERNS)[int(rng.integers(len(PATTERNS)))]


def _draw_panoramas(rng: np.random.Generator, kind: str, light: Light) -> tuple[PanoramaLight, ...]:
    if kind == "environment":
        brightness = sum(_brightness(panorama) for panorama in light.panoramas)
        factor = 1.0
        if light.kind == "silhouette":
            factor = float(rng.uniform(0.7, 2.2)) / max(brightness, 1e-6)
        elif light.kind == "backlit":
            factor = float(rng.uniform(0.8, 2.2))
        return tuple(scaled_panorama(panorama, factor) for panorama in light.panoramas)
    name = str(rng.choice(environment_names()))
    heading, tilt = float(rng.uniform(0, 360)), float(np.clip(rng.normal(0, 8), -30, 30))
    panorama = PanoramaLight(
        name=name, heading_deg=round(heading, 2), tilt_deg=round(tilt, 2), roll_deg=0.0, colour_matrix=_IDENTITY
    )
    wanted = max(light.illuminance, 0.1) * float(np.exp(rng.uniform(np.log(0.5), np.log(2.5))))
    if light.kind == "night":
        wanted *= 0.4
    return (scaled_panorama(panorama, wanted / max(_brightness(panorama), 1e-6)),)


def _brightness(panorama: PanoramaLight) -> float:
    """Returns the mean luminance without lamps, which cover a small part of a picture."""
    return float(LUMINANCE @ np.array(panorama.colour_matrix) @ environment(panorama.name).harmonics[0])


def _draw_level(rng: np.random.Generator, config: BackdropConfig, light: Light, *, is_plain: bool) -> float:
    low, high = np.log(config.brightness)
    if is_plain or light.kind == "silhouette":
        low = (low + high) / 2
    light_there = 1.4 if light.kind == "silhouette" else max(light.illuminance, 0.08)
    factor = float(np.exp(rng.uniform(low, high)))
    return round(min(factor * light_there, 3.0), 4)


def _draw_people(rng: np.random.Generator, config: BackdropConfig) -> tuple[PersonPlace, ...]:
    """Draws the people behind. The number of draws does not depend on whether there are any."""
    shows, count = rng.uniform() < config.people_share, int(rng.integers(1, max(config.most_people, 1) + 1))
    numbers = rng.uniform(0, 1, size=(3, 5))
    if not shows or config.most_people == 0:
        return ()
    return tuple(
        PersonPlace(
            x=rounded(-0.05 + 1.1 * a, 4),
            y=rounded(0.15 + 0.5 * b, 4),
            scale=rounded(0.18 + 0.42 * c, 4),
            blur=rounded(0.004 + 0.02 * d, 5),
            seed=int(e * 2**31),
        )
        for a, b, c, d, e in numbers[:count]
    )
