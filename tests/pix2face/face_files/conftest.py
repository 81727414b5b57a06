"""The files of AFLW2000-3D, read once."""

from pathlib import Path

import pytest

from pix2face.face_files.w300lp import CoefficientFile, read_coefficient_file
from tests.keypoint_model import KeypointModel, fit_keypoint_model_to


@pytest.fixture(scope="session")
def dev_files(shared_dir: Path) -> list[CoefficientFile]:
    paths = sorted((shared_dir / "data" / "aflw2000_3d" / "dev").glob("*.mat"))
    return [read_coefficient_file(path) for path in paths]


@pytest.fixture(scope="session")
def keypoints(dev_files: list[CoefficientFile]) -> KeypointModel:
    return fit_keypoint_model_to(dev_files)
