"""The model of small made benchmarks."""

import pytest

from tests.synthetic_models import small_head_model


@pytest.fixture
def small_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever --model says, the small head is opened: evaluation needs no particular face."""
    model = small_head_model()
    monkeypatch.setattr("pix2face.landmark_choice.landmark_file.open_model", lambda name: model)
