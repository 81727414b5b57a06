"""Draws scenes that are hard for the packaged detector: misses, false boxes, and faces with low scores.

People and backgrounds should not be those of the training:

    datagen sample --n 120 --size 224 --appearance docs/measurements/detector/heads.toml --seed 900 --out heads.h5
    datagen render --coeffs heads.h5 --appearance docs/measurements/detector/heads.toml --seed 900
        --layers image,coverage,landmarks --out heads/
    datagen empty --held-out --n 200 --seed 7 --out empty/
    python -m scripts.draw_detector_scenes --shards heads/ --backgrounds empty/
"""

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
from numpy import ndarray

from pix2face.detectors import SURE_SCORE
from pix2face.detectors.centre_detector import CentreDetector
from pix2face.detectors.protocol import overlap
from pix2face.files.images import encode_photograph
from pix2face.geometry.crops import FaceBox
from training.data.shard_folders import parse_shard_folders
from training.data.shard_index import index_shards
from training.detection.backgrounds import Backgrounds
from training.detection.decoys import Things
from training.detection.people import PEOPLE_LAYERS, People
from training.detection.scenes import Scene, SceneMaker

SCENES, COLUMNS, SIZE_PX, SEED = 400, 6, 256, 1  # the training had seed 0
HIT_OVERLAP = 0.4
TRUE, FOUND, FALSE, UNCOUNTED = (60, 110, 255), (60, 220, 60), (255, 60, 40), (150, 150, 150)


def main() -> int:
    """Draws a row of misses, one of false boxes, and two of faces with low scores."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shards", required=True)
    parser.add_argument("--backgrounds", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=Path("docs/images/detector_scenes.jpg"))
    options = parser.parse_args()
    people = People(index_shards(parse_shard_folders((options.shards,)), layers=PEOPLE_LAYERS))
    maker = SceneMaker(people, Backgrounds(options.backgrounds), Things([]), SIZE_PX, SEED)
    detector = CentreDetector.load()
    judged = [judge(maker.make(number), detector) for number in range(SCENES)]
    counts = np.array([row[1:4] for row in judged]).sum(axis=0)
    print(f"{SCENES} scenes: {counts[0]} faces, {counts[1]} missed, {counts[2]} false boxes")
    missed = [tile for tile, _, misses, _, _ in judged if misses][:COLUMNS]
    false = [tile for tile, _, misses, wrong, _ in judged if wrong and not misses][:COLUMNS]
    hard = sorted((row for row in judged if not row[2] and not row[3] and row[1]), key=lambda row: row[4])
    rows = [missed, false, [row[0] for row in hard[:COLUMNS]], [row[0] for row in hard[COLUMNS : 2 * COLUMNS]]]
    sheet = np.vstack([np.hstack(row + [np.zeros_like(judged[0][0])] * (COLUMNS - len(row))) for row in rows])
    options.out.write_bytes(encode_photograph(sheet))
    return 0


def judge(scene: Scene, detector: CentreDetector) -> tuple[ndarray, int, int, int, float]:
    """Returns a scene with boxes, its number of faces, misses and false boxes, and the lowest score of a face."""
    found = [face for face in detector.candidates(scene.image) if face.score >= SURE_SCORE]
    picture, scores, n_faces = scene.image.copy(), [], 0
    faces = [FaceBox(*box.tolist()) for box in scene.boxes]
    for face, counts in zip(faces, scene.is_counted, strict=True):
        scores += [max((own.score for own in found if overlap(own.box, face) > HIT_OVERLAP), default=0.0)] * counts
        n_faces += counts
        outline(picture, face, TRUE if counts else UNCOUNTED)
    n_false = 0
    for own in found:
        is_face = any(overlap(own.box, face) > HIT_OVERLAP for face in faces)
        n_false += not is_face
        outline(picture, own.box, FOUND if is_face else FALSE)
    return picture, n_faces, sum(score == 0 for score in scores), n_false, min(scores, default=9.0)


def outline(picture: ndarray, box: FaceBox, colour: tuple[int, int, int]) -> None:
    """Draws a box."""
    left, top, right, bottom = (round(side) for side in (box.left, box.top, box.right, box.bottom))
    cv2.rectangle(picture, (left, top), (right, bottom), colour, 1)


if __name__ == "__main__":
    sys.exit(main())
