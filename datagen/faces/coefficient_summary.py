"""What a table or a folder of coefficients holds: poses, spread of coefficients, what is rare, what was rejected."""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from datagen.faces.sources import coefficient_paths
from datagen.sampling.summary import drawn_shares
from pix2face.errors import InputFileError, UsageError
from pix2face.face_files.annotations import picture_beside
from pix2face.face_files.coefficients import FaceCoefficients
from pix2face.face_files.w300lp import CoefficientFile, read_coefficient_file
from pix2face.geometry.camera import Camera, head_pose

# Poses of more faces than this are taken from an even choice of them.
MEASURED_POSES = 20_000
RARE = 0.05
LARGE_COEFFICIENT = 3.0
USUAL_ANGLE_DEG = 99.0
ANGLES = ("pitch", "yaw", "roll")
EDGES_DEG = {
    "pitch": (-90.0, -20.0, 20.0, 90.0),
    "yaw": (-90.0, -60.0, -30.0, 30.0, 60.0, 90.0),
    "roll": (-90.0, -20.0, 20.0, 90.0),
}


@final
@dataclass(frozen=True, kw_only=True)
class CoefficientSummary:
    """Figures of a source.

    Attributes:
        facts: What is printed first: name and value.
        shares: For each angle its bins (degrees) with their share of the faces.
        reasons: Why faces were rejected, with paths and ids taken out, and how many.
        drawn: Shares of what else is known of drawn faces.
    """

    facts: dict[str, str]
    shares: dict[str, dict[str, float]]
    reasons: tuple[tuple[str, int], ...]
    drawn: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def rare(self) -> tuple[str, ...]:
        """Bins with fewer than 5 % of the faces."""
        return tuple(
            f"{angle} {name} ({100 * share:.1f} %)"
            for angle, bins in self.shares.items()
            for name, share in bins.items()
            if share < RARE
        )


def summarise_table(table: FaceCoefficients) -> CoefficientSummary:
    """Figures of a table.

    Raises:
        UsageError: It holds no face.
    """
    if not len(table):
        raise UsageError("expected a table with at least one face, found none")
    chosen = range(0, len(table), -(-len(table) // MEASURED_POSES))
    poses = [head_pose(Camera(table.cameras[index])) for index in chosen]
    angles = np.array([(pose.pitch_deg, pose.yaw_deg, pose.roll_deg) for pose in poses])
    affine = np.mean([Camera(table.cameras[index]).is_affine for index in chosen])
    facts = {
        "faces": f"{len(table)} ({sum(map(bool, table.image_paths))} with a photograph)",
        "model": f"{table.model_name} ({table.model_sha256[:12]})",
        "coefficients": f"{table.identity.shape[1]} identity, {table.expression.shape[1]} expression",
        "lighting": "none" if table.lighting is None else f"{table.lighting.shape[1]} numbers a face",
        **_spread("identity", table.identity),
        **_spread("expression", table.expression),
        "cameras": f"{100 * affine:.0f} % weak perspective or affine, {100 * (1 - affine):.0f} % pinhole",
        "pictures": _sizes(table),
        **_angle_facts(angles),
        "licence": table.licence or "that of the model",
        "made by": table.configuration,
    }
    drawn = drawn_shares(table, angles[:, 1])
    return CoefficientSummary(facts=facts, shares=_shares(angles), reasons=group_reasons(table.rejected), drawn=drawn)


def summarise_folder(folder: Path, on_progress: Callable[[int], None]) -> CoefficientSummary:
    """Figures of a folder of 300W-LP or AFLW2000-3D files, as they stand in the files.

    Raises:
        UsageError: There is no file that can be read.
    """
    rejected, heads, counts = [], [], Counter[str]()
    for path in coefficient_paths(folder):
        try:
            file = read_coefficient_file(path)
            picture_beside(path)
            heads.append((file.pose.head.pitch_deg, file.pose.head.yaw_deg, file.pose.head.roll_deg))
            counts.update(_kinds(file))
        except InputFileError as error:
            rejected.append((path.stem, str(error)))
        on_progress(1)
    if not heads:
        raise UsageError(
            f"{folder}: expected files of 300W-LP or AFLW2000-3D with their pictures, found "
            + (f"{len(rejected)} that cannot be used; the first: {rejected[0][1]}" if rejected else "none")
        )
    stored = np.array(heads)
    unusual = int((np.abs(stored) > USUAL_ANGLE_DEG).any(axis=1).sum())
    angles = (stored + 180) % 360 - 180
    facts = {
        "faces": f"{len(heads)} with a picture, {len(rejected)} that cannot be used",
        "model": "BFM 2009 (with another model, the landmarks are fitted)",
        "landmarks": ", ".join(f"{name} in {count}" for name, count in counts.items() if name.startswith("p"))
        or "none",
        "lighting": f"in {counts['lighting']}",
        "unusual": f"angles beyond ±{USUAL_ANGLE_DEG:.0f}° in {unusual}, negative scale in {counts['negative scale']}",
        **_angle_facts(angles),
    }
    return CoefficientSummary(facts=facts, shares=_shares(angles), reasons=group_reasons(rejected))


def group_reasons(rejected: Iterable[tuple[str, str]]) -> tuple[tuple[str, int], ...]:
    """Counts reasons, most frequent first; what names a single face (paths, its id) is taken out."""
    counts: Counter[str] = Counter()
    for sample_id, reason in rejected:
        text = re.sub(r"\S*/\S*|\S+\.mat\b:?", "...", re.sub(rf"(?<!\w){re.escape(sample_id)}(?!\w)", "...", reason))
        counts[re.sub(r"(\.\.\.:? *)+", "... ", text).strip()] += 1
    return tuple(counts.most_common())


def _kinds(file: CoefficientFile) -> list[str]:
    found = {
        "pt3d_68": file.landmarks3d is not None,
        "pt2d": file.landmarks2d is not None,
        "lighting": file.lighting is not None,
        "negative scale": file.pose.scale < 0,
    }
    return [name for name, is_there in found.items() if is_there]


def _spread(name: str, coefficients: Float[ndarray, "n k"]) -> dict[str, str]:
    if not coefficients.size:
        return {f"{name} RMS": "no coefficients"}
    rms = np.sqrt((coefficients.astype(np.float64) ** 2).mean(axis=1))
    large = 100 * float((np.abs(coefficients) > LARGE_COEFFICIENT).any(axis=1).mean())
    return {
        f"{name} RMS": f"{rms.mean():.2f} standard deviations (faces: {rms.min():.2f} to {rms.max():.2f}), "
        f"{large:.1f} % of the faces with one beyond ±{LARGE_COEFFICIENT:.0f}"
    }


def _sizes(table: FaceCoefficients) -> str:
    sizes, counts = np.unique(table.sizes_px, axis=0, return_counts=True)
    (height, width), n = sizes[counts.argmax()], counts.max()
    return f"{width} x {height} px" + (f" in {n}; {len(sizes)} sizes in all" if len(sizes) > 1 else "")


def _angle_facts(angles: Float64[ndarray, "n 3"]) -> dict[str, str]:
    return {
        name: f"mean {values.mean():.1f}°, deviation {values.std():.1f}°, {values.min():.0f}° to {values.max():.0f}°"
        for name, values in zip(ANGLES, angles.T, strict=True)
    }


def _shares(angles: Float64[ndarray, "n 3"]) -> dict[str, dict[str, float]]:
    return {name: _bins(EDGES_DEG[name], values) for name, values in zip(ANGLES, angles.T, strict=True)}


def _bins(edges: Sequence[float], values: Float64[ndarray, " n"]) -> dict[str, float]:
    inside = {
        f"{low:.0f}..{high:.0f}°": float(((values >= low) & (values < high)).mean()) for low, high in pairwise(edges)
    }
    return {**inside, f"beyond ±{edges[-1]:.0f}°": float((np.abs(values) >= edges[-1]).mean())}
