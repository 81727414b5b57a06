"""What importing a part of the project brings along, seen in a process of its own, and the contracts between parts."""

import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import datagen

ROOT = Path(__file__).parents[1]
DATAGEN_MODULES = sorted(
    module.name for module in pkgutil.walk_packages(datagen.__path__, "datagen.") if not module.ispkg
)
TRAINING_NEEDS_NO = {"moderngl", "glcontext", "datagen"}
INFERENCE_NEEDS_NO = {"h5py", "moderngl", "glcontext", "datagen", "training"}


def loaded_by(*modules: str) -> set[str]:
    """Top-level modules that are there after importing some, in a fresh process."""
    code = f"import sys, {', '.join(modules)}; print(*{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return set(run.stdout.split())


def test_inference_loads_neither_hdf5_nor_gl() -> None:
    loaded = loaded_by("pix2face.inference.predictor")
    assert "torch" in loaded
    assert not loaded & INFERENCE_NEEDS_NO


def test_hdf5_would_be_seen_in_inference() -> None:
    assert loaded_by("pix2face.inference.predictor", "pix2face.shards.shard_reader") & INFERENCE_NEEDS_NO == {"h5py"}


def test_the_package_itself_loads_neither_torch_nor_hdf5() -> None:
    assert not loaded_by("pix2face") & {"torch", "h5py", "numpy", "cv2"}


def test_torch_would_be_seen_in_the_package() -> None:
    assert {"torch", "h5py"} <= loaded_by("pix2face, pix2face.api")


def test_no_module_of_datagen_loads_torch() -> None:
    assert {"datagen.cli", "datagen.rendering.renderer", "datagen.appearance.scene"} <= set(DATAGEN_MODULES)
    loaded = loaded_by(*DATAGEN_MODULES)
    assert "moderngl" in loaded
    assert not loaded & {"torch", "training"}


@pytest.mark.parametrize("module", ["torch", "training.loop.losses"])
def test_torch_would_be_seen_in_datagen(module: str) -> None:
    assert "torch" in loaded_by("datagen.cli", module)


def test_training_loads_no_gl() -> None:
    loaded = loaded_by("training.cli")
    assert "torch" in loaded
    assert not loaded & TRAINING_NEEDS_NO


def test_gl_would_be_seen_in_training() -> None:
    assert loaded_by("training.cli", "datagen.opengl.gl_context") & TRAINING_NEEDS_NO >= {"moderngl", "datagen"}


def check_contracts(folder: Path) -> subprocess.CompletedProcess[str]:
    program = shutil.which("lint-imports", path=str(Path(sys.executable).parent)) or shutil.which("lint-imports")
    assert program is not None, "import-linter is not installed: pip install -e '.[dev]'"
    return subprocess.run([program, "--no-cache"], cwd=folder, capture_output=True, text=True)


def test_contracts_between_packages_hold() -> None:
    run = check_contracts(ROOT)
    assert run.returncode == 0, run.stdout
    assert "0 broken" in run.stdout


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("pix2face/geometry/camera.py", "import training.loop.losses"),
        ("datagen/sampling/faces.py", "import torch"),
        ("training/loop/losses.py", "import moderngl"),
        ("training/loop/losses.py", "import datagen.sampling.faces"),
        ("pix2face/models/rasterise.py", "import torch"),
    ],
)
def test_a_broken_contract_would_be_seen(tmp_path: Path, path: str, line: str) -> None:
    for package in ("pix2face", "datagen", "training"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("assets", "__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    changed = tmp_path / path
    changed.write_text(f"{changed.read_text()}\n{line}\n")
    run = check_contracts(tmp_path)
    assert run.returncode != 0
    assert "0 broken" not in run.stdout
    assert "BROKEN" in run.stdout
