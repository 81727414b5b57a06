"""Draws plausible faces, poses and cameras from a morphable model, each with a random stream of its own.

The distributions are those of a `GeometryConfig` (docs/explanation/sampling.md), or these if it `is_plain`:

- identity: standard normal, clipped at ±2.5;
- expression: one in five is neutral. The others are one to four of the model's named expressions at 0.2 to 1 of their
  full strength. The two sides of a pair are drawn together, each at 75 to 100 % of the pair's strength. An expression
  that needs another one (a closed mouth on an open jaw) adds it. Without named expressions, coefficients are normal
  with a deviation of 0.6;
- head: 60 % of the yaws are normal (18°) and 40 % uniform, clipped at ±90°; pitch is normal (12°, clipped at ±40°), and
  so is roll (12°, clipped at ±45°);
- camera: pinhole with the principal point at the centre of the picture and a log-uniform distance from 0.35 m (arm's
  length) to 4 m. The picture is 1.5 to 2.1 times as large as the face box, and its centre is shifted by up to 10 % of
  the box.
"""

import json
from dataclasses import asdict, dataclass
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from datagen.random_streams import generator_for
from datagen.sampling.expressions import (
    NAMED_EXPRESSIONS,
    draw_named_expression,
    expression_of,
    knows_recipes,
    strengths_to_text,
)
from datagen.sampling.sampling_config import PLAIN_GEOMETRY, GeometryConfig
from datagen.sampling.teeth import ToothGuard
from datagen.sampling.views import camera_attributes, draw_photographed_view, photograph_face
from pix2face.errors import UsageError
from pix2face.face_files.coefficients import LARGEST_SIDE_PX, FaceCoefficients, configuration_to_json
from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    Pinhole,
    WeakPerspective,
    pinhole_camera,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.morphable_model import MorphableModel

MOST_FACES = 10_000_000
SMALLEST_SIDE_PX = 16
LARGEST_DEVIATION = 2.5
N_LARGEST_COMPONENTS = 10
NEUTRAL_SHARE = 0.2
EXPRESSION_DEVIATION = 0.6  # for models without named expressions
# Expressions that need another one.
NEEDED_EXPRESSIONS = {"mouthClose": "jawOpen", "tongueOut": "jawOpen"}
WIDE_YAW_SHARE = 0.4


@final
@dataclass(frozen=True)
class SampledView:
    """Pose, distance and framing of a face."""

    pose: HeadPose
    distance_mm: float
    picture_per_box: float
    shift: tuple[float, float]


# Identity, expression, camera and attributes of one face.
_Face = tuple[Float64[ndarray, " k"], Float64[ndarray, " e"], Camera, dict[str, str | float]]


def sample_faces(
    model: MorphableModel, n: int, seed: int, size_px: int, geometry: GeometryConfig = PLAIN_GEOMETRY
) -> FaceCoefficients:
    """Draws faces.

    Args:
        model: Morphable model with 68 landmarks, which frame the picture.
        n: Number of faces, from 1 to 10,000,000, since ids have seven digits.
        seed: Any integer from 0. With the same seed, the first faces do not depend on ``n``.
        size_px: Side of the pictures to be rendered, from 16 to 16384.
        geometry: Distributions of poses, cameras, crops, expressions and identities.

    Raises:
        UsageError: A number is outside its limits, or the model lacks landmarks.
    """
    geometry.check()
    _check_request(model, n, seed, size_px)
    sample_ids = tuple(f"seed{seed}/{index:07d}" for index in range(n))
    identity = np.zeros((n, model.n_identity), dtype=np.float32)
    expression = np.zeros((n, model.n_expression), dtype=np.float32)
    cameras = np.zeros((n, 4, 4))
    attributes = []
    guard = ToothGuard(model)
    for index, sample_id in enumerate(sample_ids):
        if geometry.is_plain:
            face = _plain_face(model, generator_for(seed, sample_id), size_px)
        else:
            face = _face(model, (seed, sample_id), size_px, geometry, guard)
        identity[index], expression[index], camera, described = face
        cameras[index] = camera.matrix
        attributes.append(json.dumps({"geometry": "drawn by datagen sample", **described}))
    drawn = {} if geometry.is_plain else {"geometry": asdict(geometry)}
    return FaceCoefficients(
        model_name=model.name,
        model_sha256=model.sha256,
        sample_ids=sample_ids,
        identity=identity,
        expression=expression,
        cameras=cameras,
        sizes_px=np.full((n, 2), size_px, dtype=np.int32),
        image_paths=("",) * n,
        attributes=tuple(attributes),
        configuration=configuration_to_json({"n": n, "seed": seed, "size_px": size_px, **drawn}),
    )


def _check_request(model: MorphableModel, n: int, seed: int, size_px: int) -> None:
    if not 1 <= n <= MOST_FACES:
        raise UsageError(f"--n: expected 1 to {MOST_FACES} faces, found {n}")
    if not SMALLEST_SIDE_PX <= size_px <= LARGEST_SIDE_PX:
        raise UsageError(f"--size: expected {SMALLEST_SIDE_PX} to {LARGEST_SIDE_PX} pixels, found {size_px}")
    if seed < 0:
        raise UsageError(f"--seed: expected 0 or more, found {seed}")
    if IBUG68 not in model.landmarks:
        raise UsageError(f"expected a model with {IBUG68} landmarks (they frame the picture), {model.name} has none")


def _plain_face(model: MorphableModel, rng: np.random.Generator, size_px: int) -> _Face:
    identity = np.clip(rng.standard_normal(model.n_identity), -LARGEST_DEVIATION, LARGEST_DEVIATION)
    expression = draw_expression(model, rng)
    landmarks = _landmarks(model, identity.astype(np.float32), expression.astype(np.float32))
    return identity, expression, frame_face(landmarks, draw_view(rng), size_px), {}


def _face(
    model: MorphableModel, seed: tuple[int, str], size_px: int, geometry: GeometryConfig, guard: ToothGuard
) -> _Face:
    # With separate streams, another configuration of poses does not change the faces.
    identity_rng, expression_rng, view_rng = (
        generator_for(seed[0], f"{seed[1]}/{part}") for part in ("identity", "expression", "view")
    )
    identity = _draw_identity(model.n_identity, identity_rng, geometry)
    described: dict[str, str | float] = {}
    if knows_recipes(tuple(model.named_expressions)):
        drawn = draw_named_expression(expression_rng, geometry, tuple(model.named_expressions))
        strengths = guard.tamed(identity, drawn.strengths)
        expression = expression_of(model, strengths)
        described |= {"expression": drawn.kind, NAMED_EXPRESSIONS: strengths_to_text(strengths)}
    else:
        expression = draw_expression(model, expression_rng)
    view = draw_photographed_view(view_rng, geometry)
    camera = photograph_face(_landmarks(model, identity, expression), view, size_px)
    described |= {**camera_attributes(camera), "distance_mm": round(view.distance_mm)}
    return identity, expression, camera, described


def _draw_identity(n: int, rng: np.random.Generator, geometry: GeometryConfig) -> Float64[ndarray, " k"]:
    identity = np.clip(rng.standard_normal(n), -LARGEST_DEVIATION, LARGEST_DEVIATION)
    if rng.random() < geometry.extreme_identity_share:
        # The largest components describe the effects of age, weight and sex.
        count = min(int(rng.integers(1, 4)), n)
        which = rng.choice(min(n, N_LARGEST_COMPONENTS), count, replace=False)
        identity[which] = rng.choice([-1.0, 1.0], count) * rng.uniform(*geometry.extreme_identity, count)
    return identity * geometry.identity_spread


def draw_expression(model: MorphableModel, rng: np.random.Generator) -> Float64[ndarray, " e"]:
    """Draws expression coefficients in standard deviations."""
    if rng.random() < NEUTRAL_SHARE:
        return np.zeros(model.n_expression)
    if not model.named_expressions:
        return rng.normal(0, EXPRESSION_DEVIATION, model.n_expression)
    groups = _paired_expressions(tuple(model.named_expressions))
    total = np.zeros(model.n_expression)
    for group in rng.choice(len(groups), size=min(int(rng.integers(1, 5)), len(groups)), replace=False):
        strength = rng.uniform(0.2, 1.0)
        for name in groups[group]:
            # Both sides of a face move together, but not equally.
            total += strength * rng.uniform(0.75, 1.0) * model.named_expressions[name]
            needed = model.named_expressions.get(NEEDED_EXPRESSIONS.get(name, ""))
            if needed is not None:
                total += strength * needed
    return total


def draw_view(rng: np.random.Generator) -> SampledView:
    """Draws a pose, a distance and a framing."""
    wide = rng.random() < WIDE_YAW_SHARE
    yaw = rng.uniform(-90, 90) if wide else rng.normal(0, 18)
    pitch = np.clip(rng.normal(0, 12), -40, 40)
    roll = np.clip(rng.normal(0, 12), -45, 45)
    return SampledView(
        pose=HeadPose(float(pitch), float(np.clip(yaw, -90, 90)), float(roll)),
        distance_mm=float(np.exp(rng.uniform(np.log(350), np.log(4000)))),
        picture_per_box=float(rng.uniform(1.5, 2.1)),
        shift=(float(rng.uniform(-0.1, 0.1)), float(rng.uniform(-0.1, 0.1))),
    )


def frame_face(landmarks_mm: Float64[ndarray, "m 3"], view: SampledView, size_px: int) -> Camera:
    """Returns a pinhole camera that shows a face (landmarks in mm, model frame) in a given pose and framing."""
    rotation = rotation_of_pose(view.pose)
    flat = weak_perspective_camera(WeakPerspective(1.0, rotation, np.zeros(2)))
    box = FaceBox.around(flat.project(landmarks_mm))
    # Pixels per mm at the distance of the landmarks' centre.
    scale = size_px / (view.picture_per_box * box.longer_side)
    centre = np.append(box.centre, flat.depth(landmarks_mm).mean())
    shift = np.array([*view.shift, 0]) * box.longer_side
    translation = np.array([0, 0, view.distance_mm]) - centre + shift
    return pinhole_camera(Pinhole(scale * view.distance_mm, np.full(2, size_px / 2), rotation, translation))


def _landmarks(model: MorphableModel, identity: ndarray, expression: ndarray) -> Float64[ndarray, "m 3"]:
    vertices = model.landmarks[IBUG68]
    n = 3 * len(vertices)
    moved = identity @ model.identity_basis[:, vertices].reshape(model.n_identity, n)
    moved = moved + expression @ model.expression_basis[:, vertices].reshape(model.n_expression, n)
    return np.asarray(model.mean[vertices] + moved.reshape(-1, 3), dtype=np.float64)


def _paired_expressions(names: tuple[str, ...]) -> list[list[str]]:
    """Groups the left and the right version of each expression."""
    groups: dict[str, list[str]] = {}
    for name in sorted(names):
        groups.setdefault(name.removesuffix("Left").removesuffix("Right"), []).append(name)
    return list(groups.values())
