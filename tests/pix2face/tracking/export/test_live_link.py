"""Weights of blendshapes come back, and the file is in the form of Live Link Face."""

import csv
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest

from datagen.sampling.expressions import draw_named_expression, expression_of
from datagen.sampling.sampling_config import GeometryConfig
from pix2face.errors import UsageError
from pix2face.fitting.face_fit import face_of_coefficients
from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.models.morphable_model import MorphableModel, builtin_model
from pix2face.tracking.export.blendshapes import ARKIT_NAMES, BlendshapeSolver
from pix2face.tracking.export.live_link import COLUMNS, LiveLinkFile
from tests.synthetic_models import small_head_model


@pytest.fixture(scope="module")
def model() -> MorphableModel:
    return builtin_model()


def rows_of(model: MorphableModel, frames: dict[int, tuple[HeadPose, dict[str, float]] | None]) -> list[dict[str, str]]:
    file = StringIO()
    writer = LiveLinkFile(file, model, 29.97)
    for frame, face in frames.items():
        fit = None
        if face is not None:
            camera = weak_perspective_camera(WeakPerspective(1.0, rotation_of_pose(face[0]), np.zeros(2)))
            fit = face_of_coefficients(model, camera, np.zeros(model.n_identity), expression_of(model, face[1]))
        writer.write(frame, fit)
    file.seek(0)
    return list(csv.DictReader(file))


def test_natural_mixtures_come_back_from_their_coefficients(model: MorphableModel) -> None:
    """Although there are more names than components: see the module."""
    solver = BlendshapeSolver(model)
    for seed in range(12):
        drawn = draw_named_expression(np.random.default_rng(seed), GeometryConfig(), ARKIT_NAMES).strengths
        truth = np.array([drawn.get(name, 0.0) for name in ARKIT_NAMES])
        found = solver.weights(expression_of(model, drawn))
        assert np.abs(found - truth).mean() < 0.02
        assert np.abs(found - truth).max() < 0.2


def test_all_52_names_are_arkit_s_and_the_columns_those_of_live_link_face(model: MorphableModel) -> None:
    assert len(ARKIT_NAMES) == 52
    assert set(ARKIT_NAMES) == set(model.named_expressions)
    assert len(COLUMNS) == 2 + 61
    assert COLUMNS[:3] == ("Timecode", "BlendShapeCount", "EyeBlinkLeft")
    assert COLUMNS[53:55] == ("TongueOut", "HeadYaw")


def test_a_frame_says_time_weights_and_rotations(model: MorphableModel) -> None:
    (row,) = rows_of(model, {30 * 3661 + 7: (HeadPose(-10, -20, 5), {"jawOpen": 0.6, "eyeLookOutLeft": 0.5})})
    assert row["Timecode"] == "01:01:01:07.000"
    assert row["BlendShapeCount"] == "61"
    assert float(row["JawOpen"]) == pytest.approx(0.6, abs=0.06)
    assert float(row["MouthSmileLeft"]) == pytest.approx(0, abs=0.02)
    # Down, to the subject's left, with the crown to the subject's right.
    angles = [np.degrees(float(row[f"Head{name}"])) for name in ("Pitch", "Yaw", "Roll")]
    np.testing.assert_allclose(angles, [10, 20, -5], atol=1e-3)
    left, right = (
        np.degrees([float(row[f"{eye}Eye{name}"]) for name in ("Yaw", "Pitch")]) for eye in ("Left", "Right")
    )
    assert 5 < left[0] < 9  # outwards: the left eye to the subject's left
    assert abs(left[1]) < 1
    assert np.abs(right).max() < 1


def test_a_frame_without_a_face_has_a_row_without_values(model: MorphableModel) -> None:
    missing, neutral = rows_of(model, {0: None, 1: (HeadPose(0, 0, 0), {})})
    assert (missing["Timecode"], missing["BlendShapeCount"], missing["JawOpen"]) == ("00:00:00:00.000", "0", "")
    assert neutral["Timecode"] == "00:00:00:01.000"
    assert {float(neutral[name]) for name in COLUMNS[2:]} <= {0.0, -0.0}


def test_a_model_without_eyeballs_has_still_eyes(model: MorphableModel) -> None:
    plain = replace(model, region_names=tuple(f"part{index}" for index in range(len(model.region_names))))
    (row,) = rows_of(plain, {0: (HeadPose(0, 0, 0), {"eyeLookOutLeft": 1.0})})
    assert float(row["LeftEyeYaw"]) == 0


def test_other_models_are_refused() -> None:
    with pytest.raises(UsageError, match=r"small synthetic head.*without eyeBlinkLeft; take the built-in model"):
        BlendshapeSolver(small_head_model())
