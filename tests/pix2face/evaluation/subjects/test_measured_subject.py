"""What is measured: poses in the frame that a benchmark states them in, and the versions of what influences figures."""

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import pytest

from pix2face.evaluation.benchmarks.manifest import load_manifest
from pix2face.evaluation.subjects import measured_subject
from pix2face.evaluation.subjects.measured_subject import BFM_IN_BUILTIN_DEG, model_from_stated
from pix2face.evaluation.subjects.subjects import pose_of
from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.geometry.landmarks import IBUG68
from pix2face.geometry.rigid_alignment import fit_rigid
from pix2face.models.morphable_model import builtin_model
from scripts.measure_correspondence import bfm_mean


def test_a_report_states_what_ran_the_network_and_torch_only_where_it_is_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert {"onnxruntime", "torch"} <= measured_subject.versions().keys()
    monkeypatch.setattr(measured_subject, "find_spec", lambda name: None)
    monkeypatch.setattr(measured_subject, "version", installed_without_torch)
    assert "onnxruntime" in measured_subject.versions()
    assert "torch" not in measured_subject.versions()


def installed_without_torch(name: str) -> str:
    if name == "torch":
        raise PackageNotFoundError(name)
    return version(name)


def test_a_frontal_face_of_the_stated_frame_has_no_pitch() -> None:
    turn = model_from_stated(builtin_model(), load_manifest("aflw2000-3d"))
    rotation = rotation_of_pose(HeadPose(0, 0, 0)) @ turn.T
    camera = weak_perspective_camera(
        WeakPerspective(scale=1.0, rotation=rotation, translation_px=np.array([50.0, 60.0]))
    )
    np.testing.assert_allclose(pose_of(camera, turn), 0, atol=1e-9)
    assert abs(pose_of(camera)[0] - BFM_IN_BUILTIN_DEG) < 1e-6  # which looks up in the model's own frame


def test_our_own_renders_and_other_models_keep_their_frame() -> None:
    np.testing.assert_array_equal(model_from_stated(builtin_model(), load_manifest("builtin-heldout")), np.eye(3))


def test_the_angle_is_that_between_the_mean_faces(shared_dir: Path) -> None:
    bfm, own = bfm_mean(shared_dir / "models" / "bfm_mean"), builtin_model()
    laid, _ = fit_rigid(bfm.mean[bfm.landmarks[IBUG68]], own.mean[own.landmarks[IBUG68]])
    turn = model_from_stated(own, load_manifest("aflw2000-3d"))
    apart = np.degrees(np.arccos((np.trace(turn.T @ laid.rotation) - 1) / 2))
    assert apart < 0.3
