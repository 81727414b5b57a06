"""What `datagen sample` draws: shares and ranges of poses, cameras, crops, expressions and identities.

docs/explanation/sampling.md says what comes of them.
"""

from dataclasses import dataclass
from typing import Annotated, final

from datagen.config_limits import FromZero, Limits, Range, Share, check_limits, check_parts


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
    extreme_identity_share: Share = 0.12
    extreme_identity: Annotated[Range, Limits(0, 5)] = (1.8, 2.7)
    identity_spread: Annotated[float, Limits(0, 1.3)] = 1.0
    wide_yaw_share: Share = 0.40
    wide_yaw_deg: Annotated[Range, Limits(0, 120)] = (25.0, 95.0)
    any_yaw_share: Share = 0.10
    largest_yaw_deg: Annotated[float, Limits(0, 120)] = 110.0
    frontal_yaw_deg: FromZero = 20.0
    pitch_deg: FromZero = 14.0
    wide_pitch_share: Share = 0.08
    largest_pitch_deg: Annotated[float, Limits(0, 80)] = 60.0
    roll_deg: FromZero = 12.0
    turned_share: Share = 0.03
    # Nearer, hair would reach behind the camera.
    distances_mm: Annotated[tuple[float, float, float, float], Limits(250, 100_000)] = (250.0, 600.0, 2500.0, 8000.0)
    distance_shares: Annotated[tuple[float, float, float], Limits(0, 1, is_whole=True)] = (0.25, 0.50, 0.25)
    off_axis_deg: FromZero = 6.0
    largest_off_axis_deg: Annotated[float, Limits(0, 40)] = 20.0
    picture_per_box: Annotated[Range, Limits(0.5, 10)] = (1.2, 2.0)
    shift: FromZero = 0.06
    largest_shift: Annotated[float, Limits(0, 1)] = 0.2
    off_centre_share: Share = 0.05
    off_centre_shift: Annotated[float, Limits(0, 1)] = 0.5
    neutral_share: Share = 0.15
    emotion_share: Share = 0.45
    smile_share: Share = 0.6
    speech_share: Share = 0.20
    extreme_share: Share = 0.06
    one_sided_share: Share = 0.08
    asymmetry: Annotated[float, Limits(0, 0.5)] = 0.10
    gaze_share: Share = 0.60
    shut_share: Share = 0.06
    wink_share: Share = 0.015
    half_shut_share: Share = 0.10

    def check(self) -> None:
        """Refuses numbers that nothing can be drawn from.

        Raises:
            UsageError: Names the first field that is wrong, what was expected of it and what was found.
        """
        check_limits("geometry", self)
        check_parts("geometry", self, "wide_yaw_share", "any_yaw_share")
        check_parts("geometry", self, "neutral_share", "emotion_share", "speech_share", "extreme_share")
        check_parts("geometry", self, "shut_share", "wink_share", "half_shut_share")


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
