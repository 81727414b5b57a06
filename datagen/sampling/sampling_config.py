"""Distributions of the poses, cameras, crops, expressions and identities that `datagen sample` draws.

docs/explanation/sampling.md shows the resulting distributions.
"""

from dataclasses import dataclass
from typing import Annotated, final

from datagen.config_limits import FromZero, Limits, Range, Share, check_limits, check_parts

NEAREST_MM = 250  # at smaller distances, hair would reach behind the camera


@final
@dataclass(frozen=True, kw_only=True)
class GeometryConfig:
    """Shares and ranges of everything that determines the geometry of a picture."""

    # Use the simple distributions that the first lines of `datagen/sampling/faces.py` describe, and ignore the other
    # values of this table.
    is_plain: bool = False
    # Share of faces that are far from the mean in one to three of the largest identity components.
    extreme_identity_share: Share = 0.12
    # Smallest and largest distance of these components from the mean, in standard deviations.
    extreme_identity: Annotated[Range, Limits(0, 5)] = (1.8, 2.7)
    identity_spread: Annotated[float, Limits(0, 1.3)] = 1.0  # Factor on all identity coefficients, up to 1.3.
    wide_yaw_share: Share = 0.40  # Share of heads whose yaw is uniform in `wide_yaw_deg`, to either side.
    wide_yaw_deg: Annotated[Range, Limits(0, 120)] = (25.0, 95.0)  # Smallest and largest yaw of these heads.
    # Share of heads whose yaw is uniform within `largest_yaw_deg`; all other heads are about frontal.
    any_yaw_share: Share = 0.10
    largest_yaw_deg: Annotated[float, Limits(0, 120)] = 110.0  # Largest yaw; beyond it no face is visible.
    frontal_yaw_deg: FromZero = 20.0  # Standard deviation of the yaw of heads that are about frontal.
    pitch_deg: FromZero = 14.0  # Standard deviation of the pitch of most heads.
    wide_pitch_share: Share = 0.08  # Share of heads whose pitch is uniform within `largest_pitch_deg`.
    largest_pitch_deg: Annotated[float, Limits(0, 80)] = 60.0  # Largest pitch; larger ones are clipped.
    roll_deg: FromZero = 12.0  # Standard deviation of the roll.
    turned_share: Share = 0.03  # Share of pictures that are turned by any angle: people who lie, heads upside down.
    # Edges of three ranges of distances (selfie, portrait, telephoto), each log-uniform.
    distances_mm: Annotated[tuple[float, float, float, float], Limits(NEAREST_MM, 100_000)] = (
        250.0,
        600.0,
        2500.0,
        8000.0,
    )
    # Shares of the three ranges; they sum to 1.
    distance_shares: Annotated[tuple[float, float, float], Limits(0, 1, is_whole=True)] = (0.25, 0.50, 0.25)
    # Standard deviation of the angle between the optical axis and the face, to the right and downward: most pictures of
    # a face are parts of larger photographs.
    off_axis_deg: FromZero = 6.0
    largest_off_axis_deg: Annotated[float, Limits(0, 40)] = 20.0  # Largest such angle; larger ones are clipped.
    # Smallest and largest side of the picture, as a multiple of the longer side of the landmarks' box.
    picture_per_box: Annotated[Range, Limits(0.5, 10)] = (1.2, 2.0)
    # Standard deviation of the picture's centre from that of the box, as a share of the longer side.
    shift: FromZero = 0.06
    largest_shift: Annotated[float, Limits(0, 1)] = 0.2  # Largest such shift; larger ones are clipped.
    off_centre_share: Share = 0.05  # Share of pictures whose centre is uniform within `off_centre_shift` instead.
    # Largest shift of these pictures, as a share of the longer side; at 0.5, the border runs through the face.
    off_centre_shift: Annotated[float, Limits(0, 1)] = 0.5
    neutral_share: Share = 0.15  # Share of faces at rest (except for gaze and lids).
    emotion_share: Share = 0.45  # Share of faces that show one of ten emotions.
    smile_share: Share = 0.6  # Share of those that smile, show joy or laugh, as people do in front of cameras.
    speech_share: Share = 0.20  # Share of faces that speak.
    # Share of grimaces: yawns, shouts, puffed cheeks, tongues. All other faces have a small random mixture.
    extreme_share: Share = 0.06
    # Share of emotions and grimaces that one half of the face shows much more than the other.
    one_sided_share: Share = 0.08
    # Standard deviation of the factor between the halves of the other faces.
    asymmetry: Annotated[float, Limits(0, 0.5)] = 0.10
    gaze_share: Share = 0.60  # Share of eyes that do not look straight ahead of the head.
    shut_share: Share = 0.06  # Share of faces with both eyes shut.
    wink_share: Share = 0.015  # Share of faces with one eye shut.
    half_shut_share: Share = 0.10  # Share of faces with half-closed lids.

    def check(self) -> None:
        """Raises a `UsageError` that names the first field with a number that nothing can be drawn from."""
        check_limits("geometry", self)
        check_parts("geometry", self, "wide_yaw_share", "any_yaw_share")
        check_parts("geometry", self, "neutral_share", "emotion_share", "speech_share", "extreme_share")
        check_parts("geometry", self, "shut_share", "wink_share", "half_shut_share")


DEFAULT_GEOMETRY = GeometryConfig()
PLAIN_GEOMETRY = GeometryConfig(is_plain=True)
# Rare faces and views are more frequent, and ranges are wider.
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
