"""``pix2face fit --joint``: photographs of one person, with stand-ins for detector and network."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from torch import Tensor

from pix2face.commands.cli import main
from pix2face.commands.photograph_jobs import SeenFace
from pix2face.detectors.detection import DetectedFace
from pix2face.inference.predictor import Predictor
from tests.pix2face.photographs.seen_faces import (
    PhotographedFace,
    header_of,
    network_of,
    photographed_face,
    write_picture,
)
from tests.pix2face.stub_networks import predictor_of
from tests.synthetic_models import small_head_model


def fit(*arguments: object) -> int:
    return main(["fit", *map(str, arguments)])


def two_of_one_person(
    monkeypatch: pytest.MonkeyPatch,
) -> tuple[PhotographedFace, PhotographedFace]:
    """Two faces with one identity, and stand-ins that find and see them one after the other."""
    model = small_head_model()
    first = photographed_face(model, 0)
    second = replace(photographed_face(model, 7), identity=first.identity)
    networks = iter([network_of([face.maps()]) for face in (first, second)])

    def network(images: Tensor) -> Tensor:
        return next(networks)(images)

    monkeypatch.setattr("pix2face.landmark_choice.landmark_file.open_model", lambda name: model)
    monkeypatch.setattr(Predictor, "load", lambda path, device=None: predictor_of(network, header_of(model)))
    detectors = iter([first.box, second.box])

    class OneByOne:
        def detect(self, image: np.ndarray) -> list:
            raise AssertionError("scores are wanted")

        def candidates(self, image: np.ndarray) -> list:
            return [DetectedFace(next(detectors), 1.0)]

    monkeypatch.setattr("pix2face.api.open_detector", lambda *call: OneByOne())
    return first, second


JOINT = ("--joint", "--no-refine", "--checkpoint", "any", "--regularisation", "1e-3", "--no-silhouette")


def test_photographs_of_one_person_share_the_identity(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = two_of_one_person(monkeypatch)
    paths = [
        write_picture(tmp_path / f"{name}.png", face.photograph()) for name, face in (("one", first), ("two", second))
    ]
    missing = tmp_path / "three.png"
    assert fit(*paths, missing, *JOINT, "--out", tmp_path / "out") == 3
    fits = [json.loads((tmp_path / "out" / f"{name}-0.json").read_text()) for name in ("one", "two")]
    assert fits[0]["identity"] == fits[1]["identity"]
    for found, face in zip(fits, (first, second), strict=True):
        np.testing.assert_allclose(found["identity"], face.identity, atol=0.1)
        np.testing.assert_allclose(found["expression"], face.expression, atol=0.1)
        np.testing.assert_allclose(found["landmarks2d_px"], face.landmarks2d, atol=0.15)


def test_a_photograph_that_goes_while_a_joint_fit_runs_leaves_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = two_of_one_person(monkeypatch)
    going = write_picture(tmp_path / "going.png", first.photograph())
    staying = write_picture(tmp_path / "staying.png", second.photograph())
    without_image = SeenFace.without_image

    def gone(face: SeenFace) -> SeenFace:
        going.unlink(missing_ok=True)
        return without_image(face)

    monkeypatch.setattr(SeenFace, "without_image", gone)
    assert fit(going, staying, *JOINT, "--out", tmp_path / "out") == 3
    assert f"{going}: expected a picture" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "out").glob("*.json")] == ["staying-0.json"]
