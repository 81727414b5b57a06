"""Scenes: rendered people over pictures without people, with the box of each face.

A scene depends on the seed and its number alone. What the paste itself would tell is made worthless: whole renders are
pasted as rectangles, other things are pasted with the outlines of people, and heads are pasted whose faces are painted
over, ears and other parts of heads, and drawn things. So neither an edge nor an outline says that there is a face.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray

from training.detection.backgrounds import Backgrounds
from training.detection.decoys import Things, part_of_head, textured, without_face
from training.detection.developing import develop
from training.detection.people import People, Person, halved

SCENE_STREAM = 2  # first word of the seeds: other streams order samples and vary them
# Kinds of scenes: their share, the smallest and the largest number of faces, and of the longer side of their boxes as
# a share of the picture's.
KINDS = (
    (0.15, (0, 0), (0.1, 0.5)),
    (0.40, (1, 1), (0.12, 0.95)),
    (0.27, (2, 4), (0.06, 0.45)),
    (0.18, (5, 16), (0.045, 0.16)),
)
LEAST_FACE_PX = 9.0  # smaller faces are neither to be found nor to be left alone
LEAST_INSIDE = 0.55  # nor are those of which less lies within the picture
MOST_COVERED = 0.45  # nor those of which later things cover more
BARS_SHARE = 0.12  # of scenes that end in black bars, as crops beyond the border of a photograph do
LEAST_APART, TRIES = 0.45, 6  # of two faces, as a share of the sum of their sides; tried so often


@final
@dataclass(eq=False)
class Scene:
    """A picture and its faces.

    Attributes:
        image: RGB.
        boxes: Left, top, right, bottom of each face, which may reach beyond the picture; px.
        is_counted: For each face whether it is to be found; what lies in the box of another is not looked at.
    """

    image: UInt8[ndarray, "h w 3"]
    boxes: list[Float64[ndarray, "4"]] = field(default_factory=list)
    is_counted: list[bool] = field(default_factory=list)


@final
class SceneMaker:
    """Composes scenes.

    Args:
        people: To be pasted.
        backgrounds: To paste them over.
        things: To be pasted as well.
        size_px: Side of the scenes.
        seed: Of all scenes.
    """

    def __init__(self, people: People, backgrounds: Backgrounds, things: Things, size_px: int, seed: int) -> None:
        self._people, self._backgrounds, self._things = people, backgrounds, things
        self._size_px, self._seed = size_px, seed

    def make(self, number: int) -> Scene:
        """Composes a scene; the same for the same seed and number."""
        rng = np.random.default_rng([SCENE_STREAM, self._seed, number])
        scene = Scene(self._backgrounds.draw(rng, self._size_px))
        _, (fewest, most), sizes = KINDS[int(rng.choice(len(KINDS), p=[kind[0] for kind in KINDS]))]
        self._add_rectangles(rng, scene)
        n_faces = int(rng.integers(fewest, most + 1))
        n_decoys = int(rng.integers(1, 4)) if rng.uniform() < (0.6 if n_faces == 0 else 0.35) else 0
        things = [True] * n_faces + [False] * n_decoys
        rng.shuffle(things)
        self._add_things(rng, scene)
        low, high = np.log(sizes)
        common = rng.uniform(low, high)  # the people of a group are about as large as each other
        for is_face in things:
            spread = rng.uniform(low, high) if rng.uniform() < 0.4 else np.clip(common + rng.normal(0, 0.25), low, high)
            side_px = float(np.exp(spread)) * self._size_px
            (self._add_person if is_face else self._add_decoy)(rng, scene, side_px)
        if rng.uniform() < 0.25:
            self._add_occluders(rng, scene)
        if rng.uniform() < BARS_SHARE:
            _add_bars(rng, scene)
        scene.image = develop(rng, scene.image)
        return scene

    def _add_rectangles(self, rng: np.random.Generator, scene: Scene) -> None:
        """Pictures within the picture, posters and walls, without people."""
        for _ in range(int(rng.integers(1, 5)) if rng.uniform() < 0.3 else 0):
            width, height = (
                int(extent) for extent in np.exp(rng.uniform(np.log(0.08), np.log(0.7), 2)) * self._size_px
            )
            left, top = (int(rng.integers(-extent // 2, self._size_px - extent // 2)) for extent in (width, height))
            part = self._backgrounds.draw(rng, max(width, height))[:height, :width]
            rows, columns = slice(max(top, 0), top + height), slice(max(left, 0), left + width)
            target = scene.image[rows, columns]
            target[...] = part[rows.start - top :, columns.start - left :][: target.shape[0], : target.shape[1]]

    def _add_person(self, rng: np.random.Generator, scene: Scene, side_px: float) -> None:
        person = self._people.get(int(rng.integers(len(self._people))))
        rgba = person.rgba
        if rng.uniform() < 0.12 and not person.has_environment:
            rgba = np.dstack([rgba[..., :3], np.full(rgba.shape[:2], 255, np.uint8)])
        else:
            rgba = _with_lower_edge(rng, rgba, person)
        matrix = _place(rng, person.landmarks2d, side_px, scene)
        landmarks = person.landmarks2d @ matrix[:, :2].T + matrix[:, 2]
        box = np.concatenate([landmarks.min(axis=0), landmarks.max(axis=0)])
        covered = _paste(rng, scene.image, rgba, matrix)
        _note_covered(scene, covered)
        inside = np.clip(box, 0, self._size_px)
        share = np.prod(inside[2:] - inside[:2]) / np.prod(box[2:] - box[:2])
        longer = float((box[2:] - box[:2]).max())
        scene.boxes.append(box)
        scene.is_counted.append(bool(person.is_seen and share >= LEAST_INSIDE and longer >= LEAST_FACE_PX))

    def _add_decoy(self, rng: np.random.Generator, scene: Scene, side_px: float) -> None:
        """Something with the outline of a person, a person whose face is painted over, or a part of a head."""
        person = self._people.get(int(rng.integers(len(self._people))))
        kind = rng.uniform()
        part = part_of_head(rng, person) if kind < 0.4 else None
        if part is not None:
            _note_covered(scene, _paste(rng, scene.image, part, _place(rng, _corners(part), side_px, scene)))
            return
        rgba = _with_lower_edge(rng, person.rgba, person)
        if kind < 0.7:
            height, width = rgba.shape[:2]
            rgba = np.dstack([self._backgrounds.draw(rng, max(height, width))[:height, :width], rgba[..., 3]])
        else:
            rgba = without_face(rng, rgba, person)
        _note_covered(scene, _paste(rng, scene.image, rgba, _place(rng, person.landmarks2d, side_px, scene)))

    def _add_things(self, rng: np.random.Generator, scene: Scene) -> None:
        """Drawn things, alone or many of one kind, behind the people."""
        if not len(self._things) or rng.uniform() < 0.4:
            return
        for _ in range(int(rng.integers(1, 5))):
            rgba = self._things.draw(rng)
            height, width = rgba.shape[:2]
            rgba = textured(rng, rgba, self._backgrounds.draw(rng, max(height, width))[:height, :width])
            side_px = self._size_px * float(np.exp(rng.uniform(np.log(0.05), np.log(0.7))))
            for _ in range(int(rng.integers(2, 8)) if rng.uniform() < 0.3 and side_px < 0.2 * self._size_px else 1):
                _paste(rng, scene.image, rgba, _place(rng, _corners(rgba), side_px, scene))

    def _add_occluders(self, rng: np.random.Generator, scene: Scene) -> None:
        """Things in front: bars, discs and rectangles of other pictures, most of them at faces."""
        for _ in range(int(rng.integers(1, 4))):
            if scene.boxes and rng.uniform() < 0.8:
                box = scene.boxes[int(rng.integers(len(scene.boxes)))]
                centre, reach = rng.uniform(box[:2], box[2:]), (box[2:] - box[:2]).max() * rng.uniform(0.1, 0.45)
            else:
                centre, reach = rng.uniform(0, self._size_px, 2), self._size_px * rng.uniform(0.03, 0.2)
            mask = np.zeros(scene.image.shape[:2], dtype=np.uint8)
            axes = (max(int(reach), 1), max(int(reach * rng.uniform(0.2, 1)), 1))
            if rng.uniform() < 0.5:
                cv2.ellipse(mask, centre.astype(int).tolist(), axes, rng.uniform(0, 180), 0, 360, 255, -1)
            else:
                corners = cv2.boxPoints((centre.tolist(), axes, rng.uniform(0, 180)))
                cv2.fillConvexPoly(mask, corners.astype(np.int32), 255)
            other = self._backgrounds.draw(rng, self._size_px)
            scene.image = np.where(mask[..., None] > 0, other, scene.image)
            _note_covered(scene, mask)


def _corners(rgba: UInt8[ndarray, "h w 4"]) -> Float64[ndarray, "2 2"]:
    return np.array([[0, 0], rgba.shape[1::-1]], dtype=np.float64)


def _place(
    rng: np.random.Generator, points: Float64[ndarray, "n 2"], side_px: float, scene: Scene
) -> Float64[ndarray, "2 3"]:
    """The affine map from a render to the scene: turned, mirrored and scaled, apart from other faces if it can be.

    Args:
        rng: Decides everything.
        points: Of the render, whose bounding box is to have ``side_px``.
        side_px: Longer side of the bounding box in the scene.
        scene: With the faces so far.
    """
    size_px = len(scene.image)
    roll = rng.uniform(-45, 45) if rng.uniform() < 0.2 else rng.normal(0, 10)
    angle, stretch = np.deg2rad(roll), np.exp(rng.normal(0, 0.05, 2))
    extent = np.ptp(points, axis=0)
    scale = side_px / float(extent.max())
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    mirror = np.diag([-1.0 if rng.uniform() < 0.5 else 1.0, 1.0])
    linear = scale * turn @ np.diag(stretch) @ mirror
    middle = linear @ (points.min(axis=0) + extent / 2)
    reach = 0.3 * side_px  # centres stay this far within, or half as far beyond where the picture is to cut the face
    margin = min(-0.5 * reach if rng.uniform() < 0.15 else reach, 0.45 * size_px)
    centre = rng.uniform(margin, size_px - margin, 2)
    others = np.array(scene.boxes).reshape(-1, 4)
    middles, reaches = (others[:, :2] + others[:, 2:]) / 2, (others[:, 2:] - others[:, :2]).max(axis=1, initial=0)
    for _ in range(TRIES):
        apart = np.abs(centre - middles).max(axis=1, initial=0) / (side_px + reaches)
        if apart.min(initial=1.0) > LEAST_APART:
            break
        centre = rng.uniform(margin, size_px - margin, 2)
    return np.column_stack([linear, centre - middle])


def _paste(
    rng: np.random.Generator,
    image: UInt8[ndarray, "h w 3"],
    rgba: UInt8[ndarray, "y x 4"],
    matrix: Float64[ndarray, "2 3"],
) -> UInt8[ndarray, "h w"]:
    """Draws a render over a scene, in place; returns how much of each pixel it covers."""
    covered = np.zeros(image.shape[:2], dtype=np.uint8)
    ends = np.array([[0, 0], [rgba.shape[1], 0], [rgba.shape[1], rgba.shape[0]], [0, rgba.shape[0]]])
    corners = ends @ matrix[:, :2].T + matrix[:, 2]
    left, top = np.clip(np.floor(corners.min(axis=0)), 0, None).astype(int).tolist()
    right, bottom = np.minimum(np.ceil(corners.max(axis=0)), covered.shape[::-1]).astype(int).tolist()
    if right <= left or bottom <= top:
        return covered
    small, divided = halved(rgba, float(np.sqrt(abs(np.linalg.det(matrix[:, :2])))))
    # Both frames have pixel centres at +0.5, OpenCV's have them at whole numbers.
    moved = np.column_stack([matrix[:, :2] * divided, matrix[:, 2] - [left, top]])
    moved[:, 2] += moved[:, :2] @ [0.5, 0.5] - 0.5
    drawn = cv2.warpAffine(small, moved, (right - left, bottom - top), flags=cv2.INTER_LINEAR)
    colour = drawn[..., :3].astype(np.float32)
    alpha = drawn[..., 3].astype(np.float32) * np.float32(1 / 255)
    if rng.uniform() < 0.5:  # other light, other camera
        gains = np.exp(rng.normal(0, 0.25) + rng.normal(0, 0.08, 3)).astype(np.float32)
        colour = np.minimum(colour * gains, 255)
    if rng.uniform() < 0.3:
        alpha = np.asarray(cv2.GaussianBlur(alpha, (0, 0), float(rng.uniform(0.4, 1.2))), dtype=np.float32)
    target = image[top:bottom, left:right]
    target[...] = np.rint(target + alpha[..., None] * (colour - target)).astype(np.uint8)
    covered[top:bottom, left:right] = np.rint(255 * alpha)
    return covered


def _add_bars(rng: np.random.Generator, scene: Scene) -> None:
    """Black beyond one or two sides of the picture."""
    size_px = len(scene.image)
    covered = np.zeros(scene.image.shape[:2], dtype=np.uint8)
    for _ in range(int(rng.integers(1, 3))):
        covered = np.ascontiguousarray(np.rot90(covered, int(rng.integers(4))))
        covered[: int(size_px * rng.uniform(0.03, 0.35))] = 255
    scene.image[covered > 0] = 0
    _note_covered(scene, covered)


def _note_covered(scene: Scene, covered: UInt8[ndarray, "h w"]) -> None:
    """Faces that something new covers for the most part are not counted any more."""
    for place, box in enumerate(scene.boxes):
        left, top, right, bottom = np.clip(np.rint(box), 0, len(covered)).astype(int)
        part = covered[top:bottom, left:right]
        if part.size and float(part.mean()) / 255 > MOST_COVERED:
            scene.is_counted[place] = False


def _with_lower_edge(
    rng: np.random.Generator, rgba: UInt8[ndarray, "h w 4"], person: Person
) -> UInt8[ndarray, "_ _ 4"]:
    """The straight edge where the render ends below is continued, faded out, cut at the head, or left."""
    kind = rng.uniform()
    height, width = rgba.shape[:2]
    if kind < 0.45:
        return cv2.copyMakeBorder(rgba, 0, 2 * height, 0, 0, cv2.BORDER_REPLICATE)
    if kind < 0.65:
        fade = np.clip((height - np.arange(height)) / (height * rng.uniform(0.05, 0.3)), 0, 1).astype(np.float32)
        return np.dstack([rgba[..., :3], (rgba[..., 3] * fade[:, None]).astype(np.uint8)])
    if kind < 0.85:
        low, high = person.landmarks2d.min(axis=0), person.landmarks2d.max(axis=0)
        mask = np.zeros((height, width), dtype=np.uint8)
        reach = (high - low) * rng.uniform(0.75, 1.1)
        centre = (low + high) / 2 - [0, 0.2 * reach[1]]
        cv2.ellipse(mask, centre.astype(int).tolist(), (int(reach[0]), int(reach[1])), 0, 0, 360, 255, -1, cv2.LINE_AA)
        return np.dstack([rgba[..., :3], np.minimum(rgba[..., 3], mask)])
    return rgba


def counted_boxes(scene: Scene) -> tuple[Float32[ndarray, "n 4"], Sequence[Float64[ndarray, "4"]]]:
    """The boxes of the faces that are to be found, and those of the others."""
    counted = [box for box, found in zip(scene.boxes, scene.is_counted, strict=True) if found]
    others = [box for box, found in zip(scene.boxes, scene.is_counted, strict=True) if not found]
    return np.array(counted, dtype=np.float32).reshape(-1, 4), others
