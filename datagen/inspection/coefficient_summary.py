"""What a table or a folder of coefficients holds, and why faces of it were rejected."""

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from datagen.faces.sources import coefficient_paths
from datagen.inspection.dataset_statistics import DatasetStatistics
from datagen.inspection.sample_counts import SampleCounter
from pix2face.errors import InputFileError, UsageError
from pix2face.face_files.annotations import picture_beside
from pix2face.face_files.coefficients import FaceCoefficients
from pix2face.face_files.w300lp import USUAL_ANGLE_DEG, CoefficientFile, read_coefficient_file
from pix2face.geometry.believable_face import GIVEN, measure_face
from pix2face.geometry.camera import Camera, HeadPose, unfolded

# Messages are shorter; what another program wrote as a reason may not be.
LONGEST_REASON = 2000


@final
@dataclass(frozen=True, kw_only=True)
class CoefficientSummary:
    """A table, or a folder of coefficient files."""

    facts: dict[str, str]  # names and values of what holds for the whole
    statistics: DatasetStatistics  # what the faces are like; of files, their poses
    reasons: tuple[tuple[str, int], ...]  # why faces were rejected, and how many faces for each reason


def summarise_table(table: FaceCoefficients) -> CoefficientSummary:
    """Counts the faces of a table.

    Raises:
        UsageError: It holds no face.
    """
    if not len(table):
        raise UsageError("expected a table with at least one face, found none")
    counter, n_affine = SampleCounter(), 0
    for index, sample_id in enumerate(table.sample_ids):
        camera = Camera(table.cameras[index])
        attributes = json.loads(table.attributes[index]) if table.attributes else {}
        counter.add_size(*table.sizes_px[index].tolist())
        counter.add_face(sample_id, camera, table.identity[index], table.expression[index], attributes)
        if table.image_paths[index]:
            coefficients = np.concatenate([table.identity[index], table.expression[index]])
            measures = measure_face(camera, coefficients, np.zeros((0, 2)), (1, 1))  # landmarks need the model
            counter.add_doubts(sample_id, measures.problems(GIVEN))
        n_affine += camera.is_affine
    facts = {
        "faces": f"{len(table)} ({sum(map(bool, table.image_paths))} with a photograph)",
        "model": f"{table.model_name} ({table.model_sha256[:12]})",
        "lighting": "none" if table.lighting is None else f"{table.lighting.shape[1]} numbers a face",
        "cameras": f"{n_affine} weak perspective or affine, {len(table) - n_affine} pinhole",
        "licence": table.licence or "that of the model",
        "made by": table.configuration,
    }
    return CoefficientSummary(facts=facts, statistics=counter.finish(), reasons=group_reasons(table.rejected))


def summarise_folder(folder: Path, on_progress: Callable[[int], None]) -> CoefficientSummary:
    """Counts the files of a folder of 300W-LP or AFLW2000-3D as they are, with any error in them.

    Raises:
        UsageError: There is no file that can be read.
    """
    counter, kinds = SampleCounter(), Counter[str]()
    rejected = []
    for path in coefficient_paths(folder):
        try:
            file = read_coefficient_file(path)
            picture_beside(path)
        except InputFileError as error:
            rejected.append((path.stem, str(error)))
        else:
            head = file.pose.head
            angles = np.array([head.pitch_deg, head.yaw_deg, head.roll_deg])
            counter.n += 1
            counter.add_pose(unfolded(HeadPose(*((angles + 180) % 360 - 180).tolist())))
            kinds.update(_kinds(file))
        on_progress(1)
    if not counter.n:
        raise UsageError(
            f"{folder}: expected files of 300W-LP or AFLW2000-3D with their pictures, found "
            + (f"{len(rejected)} that cannot be used; the first: {rejected[0][1]}" if rejected else "none")
        )
    landmarks = ", ".join(f"{name} in {count}" for name, count in kinds.items() if name.startswith("pt"))
    facts = {
        "faces": f"{counter.n} with a picture, {len(rejected)} that cannot be used",
        "model": "BFM 2009 (any other model is fitted to the landmarks)",
        "landmarks": landmarks or "none",
        "lighting": f"in {kinds['lighting']}",
        "unusual": f"angles beyond ±{USUAL_ANGLE_DEG:.0f}° in {kinds['unusual angle']}, "
        f"negative scale in {kinds['negative scale']}",
    }
    return CoefficientSummary(facts=facts, statistics=counter.finish(), reasons=group_reasons(rejected))


def group_reasons(rejected: Iterable[tuple[str, str]]) -> tuple[tuple[str, int], ...]:
    """Counts reasons, the most frequent first. Paths and ids, which name a single face, are replaced by dots."""
    counts: Counter[str] = Counter()
    for sample_id, reason in rejected:
        text = re.sub(r"\S+", _without_path, _without(sample_id, reason[:LONGEST_REASON]))
        counts[re.sub(r"(\.\.\.:? *)+", "... ", text).strip()] += 1
    return tuple(counts.most_common())


def _without(name: str, text: str) -> str:
    """A text with dots where a name stands in it as a word of its own."""
    if not name:
        return text
    pieces = text.split(name)
    parts = pieces[:1]
    for index, after in enumerate(pieces[1:], 1):
        left = pieces[index - 1] or name * (index > 1)
        right = after or name * (index + 1 < len(pieces))
        is_part_of_word = re.match(r"\w", left[-1:]) or re.match(r"\w", right)
        parts += [name if is_part_of_word else "...", after]
    return "".join(parts)


def _without_path(word: re.Match[str]) -> str:
    """Dots for a word that is a path, or the name of a file (in time that grows with the length of the word only)."""
    return "..." if "/" in word[0] else re.sub(r"^\S+\.mat\b:?", "...", word[0])


def _kinds(file: CoefficientFile) -> list[str]:
    found = {
        "pt3d_68": file.landmarks3d is not None,
        "pt2d": file.landmarks2d is not None,
        "lighting": file.lighting is not None,
        "negative scale": file.pose.scale < 0,
        "unusual angle": file.pose.is_unusual,
    }
    return [name for name, is_there in found.items() if is_there]
