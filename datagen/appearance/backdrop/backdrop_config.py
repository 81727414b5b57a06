"""Distributions of backdrops."""

from dataclasses import dataclass
from typing import Annotated, final

from datagen.config_limits import FromZero, Limits, Range, Share, check_limits, check_weights


@final
@dataclass(frozen=True, kw_only=True)
class BackdropConfig:
    """Weights and ranges of backdrops."""

    same_environment_weight: FromZero = 0.45  # Weight of the environment that lights the face, if one does.
    other_environment_weight: FromZero = 0.15  # Weight of any other environment.
    # Weight of generated walls, clutter, text, tiles, foliage, lights and other patterns.
    pattern_weight: FromZero = 0.32
    plain_weight: FromZero = 0.08  # Weight of a single colour: white, black, grey, green, blue, or any other.
    folder: str = ""  # A folder of pictures, which is searched recursively; empty for none.
    folder_share: Share = 0.6  # Share of backdrops from that folder, if there is one.
    # Share of environments that are shown with a wider angle than the camera's, and so with more detail.
    widened_share: Share = 0.6
    widest_view_deg: Annotated[float, Limits(10, 150)] = 100.0  # Largest angle of view of these environments.
    # Smallest and largest radius of the defocus blur, as a share of the picture's width.
    blur: Annotated[Range, Limits(0, 0.5, is_open=True)] = (0.002, 0.05)
    sharp_share: Share = 0.3  # Share of backdrops that are in focus.
    # Smallest and largest brightness relative to the light on the face, for backdrops that are not environments.
    brightness: Annotated[Range, Limits(0, 10, is_open=True)] = (0.4, 2.2)
    people_share: Share = 0.06  # Share of pictures with other people behind.
    most_people: Annotated[int, Limits(0, 3)] = 3  # Largest number of those people; 0 for none.

    def check(self) -> None:
        """Raises a `UsageError` that names the first field with a number that nothing can be drawn from."""
        check_limits("backdrop", self)
        kinds = ("same_environment", "other_environment", "pattern", "plain")
        check_weights("backdrop", self, *(f"{kind}_weight" for kind in kinds))


# More patterns and people, less blur.
HARD_BACKDROP = BackdropConfig(
    same_environment_weight=0.3,
    other_environment_weight=0.15,
    pattern_weight=0.47,
    blur=(0.001, 0.06),
    sharp_share=0.55,
    brightness=(0.1, 3.0),
    people_share=0.2,
)
