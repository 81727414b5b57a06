"""The person in a synthetic photograph: traits that skin, hair, beard and clothes share, and the pose of the body."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from datagen.random_streams import rounded
from pix2face.geometry.camera import Camera, HeadPose, published_pose, rotation_of_pose


@final
@dataclass(frozen=True, kw_only=True)
class Person:
    """Traits that the parts of an appearance share. They say nothing about the shape of the face."""

    age_years: float  # 16 to 90
    femininity: float  # 0 is male, 1 female
    african: float  # weights of the three groups sum to 1
    asian: float
    caucasian: float
    melanin: float  # 0 is the lightest skin, 1 the darkest


# Melanin of the three groups: mean and standard deviation.
_MELANIN = np.array([[0.72, 0.16], [0.36, 0.12], [0.22, 0.12]])


def draw_person(rng: np.random.Generator) -> Person:
    """Draws a person: any age, either sex, often of mixed origin."""
    weights = rng.dirichlet(np.full(3, 0.35))
    mean, spread = weights @ _MELANIN
    femininity = float(np.clip(rng.choice([0.0, 1.0]) + rng.normal(0, 0.12), 0, 1))
    return Person(
        age_years=rounded(rng.triangular(16, 26, 76), 1),
        femininity=round(femininity, 3),
        african=rounded(weights[0]),
        asian=rounded(weights[1]),
        caucasian=rounded(weights[2]),
        melanin=rounded(np.clip(rng.normal(mean, spread), 0, 1)),
    )


# Limits of the neck's motion, in degrees.
MOST_TURN_DEG, MOST_NOD_DEG, MOST_TILT_DEG = 70.0, 30.0, 25.0


@final
@dataclass(frozen=True, kw_only=True)
class Torso:
    """The shares of the head's pose that come from the neck."""

    turn: float  # share of the yaw: with 0 the whole body turns, with 1 the body faces the camera
    nod: float  # share of the pitch
    tilt: float  # share of the roll


def draw_torso(rng: np.random.Generator) -> Torso:
    """Draws the pose of a body: mostly, the body turns more than the neck, and the neck nods more than the body."""
    turn, nod, tilt = rng.beta([1.5, 3.0, 3.0], [2.0, 1.5, 1.5])
    return Torso(turn=rounded(turn), nod=rounded(nod), tilt=rounded(tilt))


def head_from_torso(torso: Torso, camera: Camera) -> Float64[ndarray, "3 3"]:
    """Returns the rotation from a body that is aligned with the head to the actual body, in the model frame."""
    head = published_pose(camera)  # instead of `head_pose`, so that profiles beyond 90° keep their yaw
    pitch = min(max(torso.nod * head.pitch_deg, -MOST_NOD_DEG), MOST_NOD_DEG)
    yaw = min(max(torso.turn * head.yaw_deg, -MOST_TURN_DEG), MOST_TURN_DEG)
    roll = min(max(torso.tilt * head.roll_deg, -MOST_TILT_DEG), MOST_TILT_DEG)
    body = HeadPose(head.pitch_deg - pitch, head.yaw_deg - yaw, head.roll_deg - roll)
    return np.asarray(rotation_of_pose(head).T @ rotation_of_pose(body))
