"""Every way from maps to a face is fitted alike: what changes one default changes all of them."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from pix2face.commands.cli import main
from pix2face.evaluation.cli import main as evaluate
from pix2face.files.images import encode_image, read_photograph
from pix2face.fitting import face_fit, joint_fit
from pix2face.fitting.fit_options import DEFAULT_FIT, FitOptions
from pix2face.inference.predictor import Predictor
from pix2face.models.morphable_model import load_model
from pix2face.photographs.refined_detection import refine_boxes
from pix2face.tracking import clip_fit
from tests.model_files import write_small_head
from tests.pix2face.benchmark_files import write_pts
from tests.pix2face.coloured_faces import camera_at, colour_predictor, draw_faces, true_box, true_landmarks
from training.data.shard_index import index_shards
from training.loop.run_configuration import checkpoint_header
from training.loop.validation import ValidationSet, Validator
from training.recipe.presets import PRESETS

CAMERA = camera_at(80, 60)
ANOTHER: dict[str, Any] = {"regularisation": 30.0, "silhouette": False, "correction": False}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A model, annotated photographs, and a network that reads it, whatever checkpoint is named."""
    model = load_model(write_small_head(tmp_path / "head.h5"))
    monkeypatch.setattr(Predictor, "load", lambda path, device=None: colour_predictor(model))
    (tmp_path / "ibug").mkdir()
    for name in ("image_003_1", "image_004_1"):
        (tmp_path / "ibug" / f"{name}.jpg").write_bytes(encode_image(draw_faces(model, [CAMERA])))
        write_pts(tmp_path / "ibug" / f"{name}.pts", true_landmarks(model, CAMERA))
    box = true_box(model, CAMERA)
    (tmp_path / "boxes.csv").write_text(
        f"frame,left,top,right,bottom\n0,{box.left},{box.top},{box.right},{box.bottom}\n"
    )
    (tmp_path / "network").touch()
    return tmp_path


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[FitOptions]:
    """The options of every fit to maps, in their order."""
    found: list[FitOptions] = []
    measure = face_fit.measure_picture

    def noted(maps: Any, model: Any, options: FitOptions, **more: Any) -> Any:
        found.append(options)
        return measure(maps, model, options, **more)

    for module in (face_fit, joint_fit, clip_fit):
        monkeypatch.setattr(module, "measure_picture", noted)
    return found


@pytest.fixture
def another_default() -> Iterator[FitOptions]:
    """Another default in all that every way takes, as long as a test runs."""
    kept = {name: getattr(DEFAULT_FIT, name) for name in ANOTHER}
    for name, value in ANOTHER.items():
        assert kept[name] != value
        object.__setattr__(DEFAULT_FIT, name, value)
    yield FitOptions(**ANOTHER)
    for name, value in kept.items():
        object.__setattr__(DEFAULT_FIT, name, value)


def photograph(folder: Path) -> Path:
    return folder / "ibug" / "image_003_1.jpg"


def call(folder: Path, program: Callable[[list[str]], int], *arguments: object) -> None:
    where = ("--model", folder / "head.h5", "--checkpoint", folder / "network", "--out", folder / "out")
    assert program([str(argument) for argument in (*arguments, *where)]) == 0


def fit(folder: Path, *more: object) -> None:
    call(folder, main, "fit", photograph(folder), "--box", 50, 30, 110, 90, "--mesh", "none", *more)


def fit_joint(folder: Path) -> None:
    fit(folder, "--joint")


def view(folder: Path) -> None:
    arguments = ("--box", 50, 30, 110, 90, "--model", folder / "head.h5", "--out", folder / "page.html")
    assert main([str(argument) for argument in ("view", photograph(folder), *arguments)]) == 0


def track(folder: Path) -> None:
    call(folder, main, "track", folder / "ibug", "--boxes", folder / "boxes.csv", "--write", "csv", "--no-refine")


def measure(folder: Path) -> None:
    call(folder, evaluate, "--split", "ibug", "--data", folder, "--allow-missing", "--resamples", 0)


def select_landmarks(folder: Path) -> None:
    arguments = ("--data", folder / "ibug", "--model", folder / "head.h5", "--out", folder / "chosen.json")
    assert main([str(argument) for argument in ("landmarks", "select", *arguments, "--folds", 2)]) == 0


def refine(folder: Path) -> None:
    model = load_model(folder / "head.h5")
    refine_boxes([(read_photograph(photograph(folder)), true_box(model, CAMERA))], colour_predictor(model), model)


class Nothing(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(1))

    def forward(self, images: Tensor) -> Tensor:
        return torch.cat([images, images, torch.ones_like(images[:, :1])], dim=1)


@pytest.fixture
def validate(shards_dir: Path) -> Callable[[Path], None]:
    shards, recipe = index_shards([shards_dir]), replace(PRESETS["cpu"], size_px=64, filters=2, planes=7)

    def run(folder: Path) -> None:
        validator = Validator(
            checkpoint_header(shards, recipe, "", 0, 0), ValidationSet(shards, recipe), load_model(folder / "head.h5")
        )
        validator.scores(Nothing())

    return run


ROUTES = [fit, fit_joint, view, track, measure, select_landmarks, refine]


def test_the_default_is_that_of_the_options():
    assert FitOptions() == DEFAULT_FIT


@pytest.mark.parametrize("route", ROUTES, ids=lambda route: route.__name__)
def test_another_default_changes_all(folder, seen, another_default, route):
    route(folder)
    assert seen
    # `evaluate` takes the type of landmarks of its benchmark.
    assert {replace(options, landmark_type=another_default.landmark_type) for options in seen} == {another_default}


def test_another_default_changes_validation(folder, seen, another_default, validate):
    validate(folder)
    assert len(seen) == 5
    assert set(seen) == {another_default}


def test_options_of_its_own_would_be_noticed(folder, seen, another_default):
    """The tests above can fail: who brings options along does not follow the default."""
    model = load_model(folder / "head.h5")
    prediction = colour_predictor(model).predict(read_photograph(photograph(folder)), true_box(model, CAMERA))
    face_fit.fit_face(prediction.maps, model, FitOptions())
    assert set(seen) == {FitOptions()}
