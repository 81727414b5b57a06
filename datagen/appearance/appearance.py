"""The appearance of a synthetic photograph. Each of its parts is drawn with a random stream of its own.

If the configuration of one part changes, or it draws more numbers, the other parts of the picture stay the same. Two
data sets can therefore differ in a single ingredient.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, final

from datagen.appearance.accessories.accessories import Accessories, accessory_textures, draw_accessories
from datagen.appearance.appearance_config import AppearanceConfig
from datagen.appearance.backdrop.backdrop import Backdrop, draw_backdrop
from datagen.appearance.hair.hair import Hair, draw_hair, hair_textures
from datagen.appearance.light.light import draw_light
from datagen.appearance.light.light_sources import Light
from datagen.appearance.light.shading import light_textures
from datagen.appearance.person import Person, Torso, draw_person, draw_torso
from datagen.appearance.photograph.faults import draw_photograph
from datagen.appearance.photograph.photograph import Photograph
from datagen.appearance.scene import Texture
from datagen.appearance.skin.skin import Skin, draw_skin
from datagen.appearance.skin.skin_textures import skin_textures
from datagen.random_streams import generator_for


@final
@dataclass(frozen=True, kw_only=True)
class Appearance:
    """Everything in a synthetic photograph except the shape and the pose of its face."""

    person: Person
    torso: Torso  # how the body stands
    skin: Skin  # with eyes, mouth and make-up
    hair: Hair  # with brows and lashes
    accessories: Accessories  # what is worn, and what is in front of the face
    light: Light
    backdrop: Backdrop  # what is behind the head
    photograph: Photograph  # what the camera and the file make of it


def draw_appearance(seed: int, sample_id: str, config: AppearanceConfig) -> Appearance:
    """Draws the appearance of one sample. It depends on seed, id and configuration only."""

    def stream(part: str) -> Any:
        return generator_for(seed, f"{sample_id}/{part}")

    person = draw_person(stream("person"))
    light = draw_light(stream("light"), config.light)
    return Appearance(
        person=person,
        torso=draw_torso(stream("torso")),
        skin=draw_skin(stream("skin"), config.skin, person),
        hair=draw_hair(stream("hair"), config.hair, person),
        accessories=draw_accessories(stream("accessories"), config.accessories, person),
        light=light,
        backdrop=draw_backdrop(stream("backdrop"), config.backdrop, light),
        photograph=draw_photograph(stream("photograph"), config.photograph),
    )


def appearance_attributes(appearance: Appearance) -> dict[str, str | float]:
    """Returns the attributes `part.name` of an appearance, which are stored with a sample and used in filters.

    Numbers have four digits, booleans are 1 or 0, and lists of objects are stored as their length. Zeros are left out
    (`pix2face.shards.sample_filter` relies on it), as are colours, places and other lists of numbers, seeds, and values
    that are useless in filters. All of them can be drawn again from the job's seed and configuration and the sample's
    id.
    """
    found: dict[str, str | float] = {}
    for part in fields(appearance):
        _describe(getattr(appearance, part.name), part.name, found)
    return found


def appearance_textures() -> Mapping[str, Texture]:
    """Returns the textures of all parts, by the names of their samplers."""
    return {**skin_textures(), **hair_textures(), **light_textures(), **accessory_textures()}


# Fields that are useless in filters.
_ONLY_TO_DRAW = frozenset(
    (
        *("seed", "enlarged_by", "read_noise_share", "metering_strength", "motion_bend", "scale_mm", "roll_off"),
        *("root_darkness", "tips_from_mm", "tips_to_mm", "sway_mm", "shift_mm", "apart_mm", "uneven_mm"),
    )
)


def _describe(part: Any, prefix: str, into: dict[str, str | float]) -> None:
    """Adds the attributes of a part, at least one, which shows that the part exists."""
    n_before, zeros = len(into), []
    for name, value in vars(part).items():
        if name in _ONLY_TO_DRAW or value is None:
            continue
        stored = f"{prefix}.{name}"
        if isinstance(value, tuple) and value and isinstance(value[0], float | int | tuple):
            continue
        number = len(value) if isinstance(value, tuple) else value
        if isinstance(number, str):
            into[stored] = number
        elif not isinstance(number, bool | int | float):
            _describe(number, stored, into)
        elif number:
            into[stored] = float(f"{number:.4g}")
        else:
            zeros.append(stored)
    if len(into) == n_before and zeros:
        into[zeros[0]] = 0.0
