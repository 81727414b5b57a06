"""The model of small made benchmarks, and reports that cost little."""

import pytest

from tests.synthetic_models import small_head_model


@pytest.fixture
def small_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever --model says, the small head is opened: evaluation needs no particular face."""
    model = small_head_model()
    monkeypatch.setattr("pix2face.landmark_choice.landmark_file.open_model", lambda name: model)


@pytest.fixture
def curves_are_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture of curves takes longer than the rest of a report; the tests of reports look at them."""
    monkeypatch.setattr("pix2face.evaluation.report.report_pictures._curves_png", lambda *curves: b"\x89PNG")
