"""Doubts about samples whose bytes are intact: ground truth that cannot be that of the photograph."""

import numpy as np

from pix2face.files.picture_head import UPRIGHT, orientation_tag
from pix2face.geometry.believable_face import GIVEN, JITTERED, measure_face
from pix2face.shards.sample import JITTER_OF, PICTURE, PictureKind, Sample

WHAT_TO_DO = (
    "convert or fit their annotations again, which rejects or corrects them now, and render again; or leave them out "
    "with --where"
)


def doubts_about(sample: Sample, size_px: tuple[int, int]) -> list[str]:
    """Why a sample of a photograph cannot be true, in words; empty where there is no doubt, and for drawn pictures.

    The size is height and width. The orientation of the picture is checked where the sample was read with it.
    """
    if sample.attributes.get(PICTURE) != PictureKind.PHOTOGRAPH:
        return []
    coefficients = np.concatenate([sample.identity, sample.expression])
    limits = JITTERED if JITTER_OF in sample.attributes else GIVEN
    doubts = measure_face(sample.camera, coefficients, sample.landmarks2d, size_px).problems(limits)
    if sample.image_bytes is not None and (tag := orientation_tag(sample.image_bytes)) != UPRIGHT:
        doubts.append(f"its picture has the orientation tag {tag}, which some programs apply and its maps do not")
    return doubts
