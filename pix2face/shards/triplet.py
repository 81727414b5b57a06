"""One sample of a shard in memory."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import final

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.geometry.camera import Camera
from pix2face.geometry.maps import FaceMaps
from pix2face.shards.layers import SEEN

MASK = "mask"
MAP_LAYERS = ("pncc", "offset", MASK)
# Attributes that other programs go by: where the picture comes from, and the face that a variant was made of.
PICTURE, JITTER_OF = "picture", "jitter_of"


class PictureKind(StrEnum):
    """Where the picture of a sample comes from: the values of its attribute `picture`.

    Attributes:
        PHOTOGRAPH: A photograph of a person.
        SYNTHETIC: A synthetic photograph, drawn from the built-in assets.
        PLAIN: A head painted region by region.
    """

    PHOTOGRAPH = "photograph"
    SYNTHETIC = "synthetic"
    PLAIN = "plain"


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Triplet:
    """One sample: a picture, its layers, and what they were made from.

    Attributes:
        sample_id: Unique in its set of shards.
        image: Content of a JPEG or PNG file: a photograph's own bytes where it was not resampled; None where the set
            has no pictures.
        layers: By name (``layers.LAYERS``), in the units given there. On the way into a shard also in steps, in the
            layer's stored dtype.
        camera: Sees the model in this picture.
        identity: Standard deviations.
        expression: Standard deviations.
        landmarks2d: Pixels; none where the set has no landmarks.
        landmarks3d: mm, model frame.
        visible: Which landmarks are inside the picture and not hidden by the head itself; ``seen_landmarks`` also goes
            by what stands before it.
        attributes: What else is known of the sample (pose in degrees, where geometry and picture come from), to filter
            on.
    """

    sample_id: str
    image: bytes | None
    layers: Mapping[str, ndarray]
    camera: Camera
    identity: Float[ndarray, " k"]
    expression: Float[ndarray, " e"]
    landmarks2d: Float[ndarray, "m 2"]
    landmarks3d: Float[ndarray, "m 3"]
    visible: Bool[ndarray, " m"]
    attributes: Mapping[str, str | float]

    @property
    def maps(self) -> FaceMaps:
        """PNCC, offset and mask together.

        Raises:
            UsageError: One of them is not there.
        """
        check_has_layers(self.layers, MAP_LAYERS, self.sample_id)
        return FaceMaps(*(self.layers[name] for name in MAP_LAYERS))

    @property
    def seen_landmarks(self) -> Bool[ndarray, " m"]:
        """Of the visible landmarks those that nothing stands before: hair, a hand, the photograph's border.

        Raises:
            UsageError: The layers mask and seen are not there.
        """
        check_has_layers(self.layers, (MASK, SEEN), self.sample_id)
        mask, seen = (np.pad(self.layers[name], 1) for name in (MASK, SEEN))
        height, width = self.layers[MASK].shape
        column, row = np.floor(self.landmarks2d).astype(np.int64).T
        # Between lips and at the silhouette the landmark's own pixel may miss the face: those around it decide, too.
        places = [
            (np.clip(row, 0, height - 1) + down, np.clip(column, 0, width - 1) + right)
            for down in range(3)
            for right in range(3)
        ]
        is_near_face = np.any([mask[place] for place in places], axis=0)
        is_near_seen = np.any([seen[place] for place in places], axis=0)
        return np.asarray(self.visible & (is_near_seen | ~is_near_face))


def check_has_layers(found: Container[str], wanted: Sequence[str], where: str) -> None:
    """Refuses what lacks a layer.

    Args:
        found: Names of the layers that there are.
        wanted: Names of those that must be among them.
        where: Whose they are, for the message.

    Raises:
        UsageError: One is missing.
    """
    missing = [name for name in wanted if name not in found]
    if missing:
        raise UsageError(
            f"{where}: expected the layers {','.join(wanted)}, found no {missing[0]}; render with --layers that name it"
        )
