"""What `datagen sample` draws: shares and ranges of poses, cameras, crops, expressions and identities.

docs/sampling.md says what comes of them.
"""

import math
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import final

from pix2face.errors import UsageError


@final
@dataclass(frozen=True, kw_only=True)
class GeometryConfig:
    """Shares and ranges of what decides the geometry of a picture.

    Attributes:
        is_plain: The simple draw of ``datagen.sampling.faces`` (its first lines say which); nothing else here counts.
        extreme_identity_share: Of faces that are far from the mean in one to three of the largest identity components.
        extreme_identity: How far those are, in standard deviations, from and to.
        identity_spread: Factor on all identity coefficients, 1 to 1.3.
        wide_yaw_share: Of heads whose yaw is uniform in ``wide_yaw_deg``, to both sides alike.
        wide_yaw_deg: From and to.
        any_yaw_share: Of heads whose yaw is uniform within ``largest_yaw_deg``; all others are about frontal.
        largest_yaw_deg: Beyond it there is no face to see.
        frontal_yaw_deg: Standard deviation of the yaw of heads that are about frontal.
        pitch_deg: Standard deviation of most heads' pitch.
        wide_pitch_share: Of heads whose pitch is uniform within ``largest_pitch_deg``.
        largest_pitch_deg: Cut.
        roll_deg: Standard deviation of the roll.
        turned_share: Of pictures that are turned by any angle: heads of people who lie, heads upside down.
        distances_mm: Edges of three ranges of distances (selfie, portrait, tele), each log-uniform.
        distance_shares: How many pictures each of them has; they sum to 1.
        off_axis_deg: Standard deviation of the angle, to the right and downward, between the optical axis and the face:
            most pictures of a face are parts of larger photographs.
        largest_off_axis_deg: Cut.
        picture_per_box: Side of the picture as a multiple of the longer side of the box of the landmarks, from and to.
        shift: Standard deviation of the picture's centre from the box's, as a share of the longer side.
        largest_shift: Cut.
        off_centre_share: Of pictures whose centre is uniform within ``off_centre_shift`` instead.
        off_centre_shift: As a share of the longer side: at half the picture's border runs through the face.
        neutral_share: Of faces at rest (gaze and lids apart).
        emotion_share: Of faces that show one of ten emotions.
        smile_share: Of those that smile, show joy or laugh, as people do before cameras.
        speech_share: Of faces that speak.
        extreme_share: Of grimaces: yawns, shouts, puffed cheeks, tongues. All others have a random small mixture.
        one_sided_share: Of emotions and grimaces that one half of the face shows much more than the other.
        asymmetry: Standard deviation of the factor between the halves of the other faces.
        gaze_share: Of eyes that look elsewhere than straight ahead of the head.
        shut_share: Of faces with both eyes shut.
        wink_share: Of faces with one eye shut.
        half_shut_share: Of faces with lids on their way.
    """

    is_plain: bool = False
    extreme_identity_share: float = 0.12
    extreme_identity: tuple[float, float] = (1.8, 2.7)
    identity_spread: float = 1.0
    wide_yaw_share: float = 0.40
    wide_yaw_deg: tuple[float, float] = (25.0, 95.0)
    any_yaw_share: float = 0.10
    largest_yaw_deg: float = 110.0
    frontal_yaw_deg: float = 20.0
    pitch_deg: float = 14.0
    wide_pitch_share: float = 0.08
    largest_pitch_deg: float = 60.0
    roll_deg: float = 12.0
    turned_share: float = 0.03
    distances_mm: tuple[float, float, float, float] = (250.0, 600.0, 2500.0, 8000.0)
    distance_shares: tuple[float, float, float] = (0.25, 0.50, 0.25)
    off_axis_deg: float = 6.0
    largest_off_axis_deg: float = 20.0
    picture_per_box: tuple[float, float] = (1.2, 2.0)
    shift: float = 0.06
    largest_shift: float = 0.2
    off_centre_share: float = 0.05
    off_centre_shift: float = 0.5
    neutral_share: float = 0.15
    emotion_share: float = 0.45
    smile_share: float = 0.6
    speech_share: float = 0.20
    extreme_share: float = 0.06
    one_sided_share: float = 0.08
    asymmetry: float = 0.10
    gaze_share: float = 0.60
    shut_share: float = 0.06
    wink_share: float = 0.015
    half_shut_share: float = 0.10

    def check(self) -> None:
        """Refuses values that nothing can be drawn from.

        Raises:
            UsageError: Names the first field that is wrong, what was expected of it and what was found.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name.endswith("_share"):
                _expect(0 <= value <= 1, field.name, "a share, 0 to 1", value)
            elif isinstance(value, float):
                _expect(math.isfinite(value) and value >= 0, field.name, "a number from 0", value)
        for name, low, high in _RANGES:
            _check_range(name, getattr(self, name), low, high)
        for name, low, high in _LIMITS:
            value = getattr(self, name)
            _expect(low <= value <= high, name, f"{low:g} to {high:g}", value)
        shares = self.distance_shares
        is_whole = len(shares) == 3 and min(shares) >= 0 and math.isclose(sum(shares), 1, abs_tol=1e-6)
        _expect(is_whole, "distance_shares", "three shares that sum to 1", shares)
        for names in _PARTS_OF_A_WHOLE:
            total = sum(getattr(self, name) for name in names)
            _expect(total <= 1 + 1e-9, names[0], f"at most 1 together with {', '.join(names[1:])}", round(total, 6))


# Fields that are ascending numbers, and what they may reach.
_RANGES = (
    ("extreme_identity", 0.0, 5.0),
    ("wide_yaw_deg", 0.0, 120.0),
    ("distances_mm", 250.0, 100_000.0),  # nearer, hair would reach behind the camera
    ("picture_per_box", 0.5, 10.0),
)
_LIMITS = (
    ("identity_spread", 0.0, 1.3),
    ("largest_yaw_deg", 0.0, 120.0),
    ("largest_pitch_deg", 0.0, 80.0),
    ("largest_off_axis_deg", 0.0, 40.0),
    ("largest_shift", 0.0, 1.0),
    ("off_centre_shift", 0.0, 1.0),
    ("asymmetry", 0.0, 0.5),
)
_PARTS_OF_A_WHOLE = (
    ("wide_yaw_share", "any_yaw_share"),
    ("neutral_share", "emotion_share", "speech_share", "extreme_share"),
    ("shut_share", "wink_share", "half_shut_share"),
)

DEFAULT_GEOMETRY = GeometryConfig()
PLAIN_GEOMETRY = GeometryConfig(is_plain=True)
# Rarer things more often, extremes wider.
HARD_GEOMETRY = GeometryConfig(
    extreme_identity_share=0.3,
    identity_spread=1.05,
    wide_yaw_share=0.55,
    wide_yaw_deg=(35.0, 100.0),
    any_yaw_share=0.15,
    pitch_deg=18.0,
    wide_pitch_share=0.25,
    roll_deg=20.0,
    turned_share=0.12,
    distance_shares=(0.45, 0.35, 0.20),
    off_axis_deg=10.0,
    picture_per_box=(1.0, 2.4),
    shift=0.1,
    largest_shift=0.3,
    off_centre_share=0.2,
    neutral_share=0.05,
    emotion_share=0.35,
    smile_share=0.3,
    speech_share=0.15,
    extreme_share=0.30,
    one_sided_share=0.2,
    gaze_share=0.8,
    shut_share=0.15,
    wink_share=0.05,
    half_shut_share=0.15,
)


def _check_range(name: str, values: tuple[float, ...], low: float, high: float) -> None:
    is_ascending = all(a <= b for a, b in pairwise(values))
    wanted = f"ascending numbers from {low:g} to {high:g}"
    _expect(is_ascending and low <= values[0] and values[-1] <= high, name, wanted, values)


def _expect(is_so: bool, name: str, wanted: str, found: object) -> None:
    if not is_so:
        raise UsageError(f"geometry: {name}: expected {wanted}, found {found}")
