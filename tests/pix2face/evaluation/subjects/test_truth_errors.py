"""What renders alone can tell: errors of coefficients and maps, by hand and on an exactly rendered face."""

import numpy as np
import pytest

from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace
from pix2face.evaluation.benchmarks.manifest import load_manifest
from pix2face.evaluation.evaluator import Evaluator
from pix2face.evaluation.report.evaluation_report import EvaluationSettings, make_report
from pix2face.evaluation.report.report_text import report_notes
from pix2face.evaluation.subjects.subjects import FoundFace, OracleSubject
from pix2face.evaluation.subjects.truth_errors import compare_coefficients, compare_maps
from pix2face.fitting.fit_options import FitOptions
from pix2face.geometry.camera import HeadPose, head_pose
from tests.pix2face.fitting.rendered_faces import render_known_face
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
K, E = MODEL.n_identity, MODEL.n_expression


def face(**changes) -> BenchmarkFace:
    facts = {"name": "seed0/0", "group": "|yaw| <= 30°", "landmarks2d": np.random.default_rng(0).uniform(0, 9, (68, 2))}
    return BenchmarkFace(**facts, read_image=lambda: np.zeros((9, 9, 3), dtype=np.uint8), **changes)


def test_errors_of_coefficients_by_hand():
    true, found = np.zeros(K), np.zeros(K)
    true[0], found[0], found[1] = 3.0, 1.0, 1.0
    own = compare_coefficients(
        MODEL,
        FoundFace(landmarks2d=None, identity=found, expression=np.full(E, 2.0)),
        face(identity=true.astype(np.float32), expression=np.full(E, 2.0, dtype=np.float32)),
    )
    assert own.identity_rms == pytest.approx(np.sqrt((2**2 + 1**2) / K))
    assert own.identity_baseline_rms == pytest.approx(3 / np.sqrt(K))
    assert (own.expression_rms, own.expression_baseline_rms) == (0, 2)
    seen = MODEL.is_face_vertex
    moved = (2 * MODEL.identity_basis[0] - MODEL.identity_basis[1])[seen]
    assert own.shape_mm == pytest.approx(np.linalg.norm(moved, axis=1).mean(), rel=1e-4)
    true_offset = 3 * MODEL.identity_basis[0] + 2 * MODEL.expression_basis.sum(axis=0)
    assert own.shape_baseline_mm == pytest.approx(np.linalg.norm(true_offset[seen], axis=1).mean(), rel=1e-4)


def test_what_either_lacks_is_not_compared():
    assert compare_coefficients(MODEL, FoundFace(landmarks2d=None), face()) is None
    assert compare_maps(FoundFace(landmarks2d=None), face()) is None


def test_the_oracle_recovers_a_rendered_face():
    """True maps give the coefficients back: what is left is the fit's own error."""
    known = render_known_face(MODEL, HeadPose(5.0, 20.0, -4.0), 3, perspective=False)
    true = face(maps=known.maps, identity=known.identity, expression=known.expression, pose=head_pose(known.camera))
    true = BenchmarkFace(**{**vars(true), "landmarks2d": known.landmarks2d(MODEL), "yaw_deg": 20.0})
    results = Evaluator(MODEL, OracleSubject(MODEL), "box-sqrt").evaluate([true])
    report = make_report(load_manifest("builtin-heldout"), EvaluationSettings(method="oracle"), {}, results)
    assert results[0].error() < 1e-3
    assert report.coefficients.identity_rms < 0.05 * report.coefficients.identity_baseline_rms
    assert report.coefficients.shape_mm < 0.1 < report.coefficients.shape_baseline_mm
    assert max(abs(results[0].pose_errors_deg.angles)) < 0.2
    assert any(note.startswith("Coefficients, RMS in standard deviations") for note in report_notes(report))
    assert any(note.startswith("Pose: found minus true") for note in report_notes(report))


def test_the_oracle_fits_the_camera_that_is_asked_for():
    """Perspective that a weak-perspective camera cannot follow is shown as an error that no network is to blame for."""
    known = render_known_face(MODEL, HeadPose(0.0, 25.0, 0.0), 5, perspective=True)
    true = BenchmarkFace(**{**vars(face(maps=known.maps)), "landmarks2d": known.landmarks2d(MODEL)})
    weak, affine = (
        Evaluator(MODEL, OracleSubject(MODEL, FitOptions(camera=camera)), "box-sqrt").evaluate([true])[0].error()
        for camera in ("weak-perspective", "affine")
    )
    assert weak > 5e-3
    assert affine != pytest.approx(weak, rel=0.02)
