"""One sample in memory: what a renderer makes, what a shard stores, and what a reader returns."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import final

from jaxtyping import Bool, Float, UInt8
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.files.images import decode_image
from pix2face.files.picture_head import declared_size_px
from pix2face.geometry.camera import Camera
from pix2face.geometry.maps import FaceMaps, uncovered_points
from pix2face.shards.layers import SEEN

MASK = "mask"
MAP_LAYERS = ("pncc", "offset", MASK)
# Attributes that other programs go by: where the picture comes from, and the face that a variant was made of.
PICTURE, JITTER_OF = "picture", "jitter_of"


class PictureKind(StrEnum):
    """Where the picture of a sample comes from: the values of its attribute `picture`."""

    PHOTOGRAPH = "photograph"  # of a person
    SYNTHETIC = "synthetic"  # drawn as a photograph, from the built-in assets
    PLAIN = "plain"  # a head painted region by region


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Sample:
    """A picture, its layers, and the face that they show.

    Pixels have their centres at +0.5, and the origin is the top left corner of the picture. The model frame has x to
    the subject's left, y up and z out of the face, in mm.

    Attributes:
        sample_id: Unique in its set of shards.
        image_bytes: The JPEG or PNG file of the picture: the original bytes of a photograph that was not resampled.
            None if the sample was stored or read without its picture.
        layers: Arrays by name, of the shapes, dtypes and units that ``pix2face.shards.layers.LAYERS`` lists: ``pncc``
            and ``offset`` are (h, w, 3) float32 in mm, ``mask`` is (h, w) bool. On the way into a shard a layer may
            also be in steps (its stored dtype).
        camera: Projects points of the model frame into this picture.
        identity: Coefficients, in standard deviations.
        expression: Coefficients, in standard deviations.
        landmarks2d: Pixels. Empty if the set has no landmarks.
        landmarks3d: mm, model frame.
        visible: Which landmarks are inside the picture and not hidden by the head itself. ``seen_landmarks`` also
            accounts for things in front of the head.
        attributes: Other facts about the sample, such as its pose in degrees and the sources of geometry and picture.
        place: File and position of the sample, for error messages. Empty if it was not read from a file.
    """

    sample_id: str
    image_bytes: bytes | None
    layers: Mapping[str, ndarray]
    camera: Camera
    identity: Float[ndarray, " k"]
    expression: Float[ndarray, " e"]
    landmarks2d: Float[ndarray, "m 2"]
    landmarks3d: Float[ndarray, "m 3"]
    visible: Bool[ndarray, " m"]
    attributes: Mapping[str, str | float]
    place: str = field(default="", repr=False)

    @property
    def image(self) -> UInt8[ndarray, "h w 3"]:
        """The picture, RGB. It is decoded at each access.

        Raises:
            UsageError: The sample has no picture.
            InputFileError: The picture cannot be decoded, or its size is not that of the layers.
        """
        where = self.place or self.sample_id
        if self.image_bytes is None:
            raise UsageError(
                f"{where}: expected a picture, found layers {','.join(self.layers) or 'none'}; "
                "name the layer image where samples are rendered and where they are read"
            )
        sizes = {values.shape[:2] for values in self.layers.values()}
        declared = declared_size_px(self.image_bytes, where)
        if sizes and declared not in sizes:
            raise InputFileError(f"{where}: expected a picture like its layers, {sizes.pop()}, found one of {declared}")
        return decode_image(self.image_bytes, where)

    @property
    def maps(self) -> FaceMaps:
        """PNCC, offset and mask together.

        Raises:
            UsageError: One of them is missing.
        """
        check_has_layers(self.layers, MAP_LAYERS, self.sample_id)
        pncc, offset, mask = (self.layers[name] for name in MAP_LAYERS)
        return FaceMaps(pncc, offset, mask)

    @property
    def seen_landmarks(self) -> Bool[ndarray, " m"]:
        """Which visible landmarks are not covered by hair, hands or other things, or by the photograph's border.

        Raises:
            UsageError: The layer ``mask`` or ``seen`` is missing.
        """
        check_has_layers(self.layers, (MASK, SEEN), self.sample_id)
        return self.visible & uncovered_points(self.landmarks2d, self.layers[MASK], self.layers[SEEN])


def check_has_layers(found: Container[str], wanted: Sequence[str], where: str) -> None:
    """Checks that all wanted layers are there; ``where`` names the sample or file in the message.

    Raises:
        UsageError: A layer is missing.
    """
    missing = [name for name in wanted if name not in found]
    if missing:
        raise UsageError(
            f"{where}: expected the layers {','.join(wanted)}, found no {missing[0]}; render with --layers that name it"
        )
