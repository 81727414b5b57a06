"""What importing a part of the project brings along, seen in a process of its own; contracts can be broken."""

import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

import datagen
from tests.test_help import PAGES, PROGRAMS

ROOT = Path(__file__).parents[1]
DATAGEN_MODULES = sorted(
    module.name for module in pkgutil.walk_packages(datagen.__path__, "datagen.") if not module.ispkg
)
TRAINING_NEEDS_NO = {"moderngl", "glcontext", "datagen"}
HELP_NEEDS_NO = {
    "torch",
    "onnxruntime",
    "scipy",
    "skimage",
    "matplotlib",
    "h5py",
    "trimesh",
    "PIL",
    "moderngl",
    "OpenEXR",
    "numba",
}
PHOTOGRAPHS_NEED_NO = {
    "torch",
    "trimesh",
    "networkx",
    "numba",
    "skimage",
    "matplotlib",
    "OpenEXR",
    "onnx",
    "scipy.optimize",
}
INFERENCE_NEEDS_NO = {"torch", "onnx", "h5py", "moderngl", "glcontext", "datagen", "training", "matplotlib", "skimage"}


def modules_after(*steps: str) -> list[set[str]]:
    """Modules that are there after one step of code after the other, in a fresh process."""
    code = "\n".join(["import sys", *(f"{step}\nprint(*sys.modules)" for step in steps)])
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return [set(line.split()) for line in run.stdout.splitlines()]


def loaded_by(*steps: str) -> list[set[str]]:
    """The same without what is inside packages."""
    return [{name.partition(".")[0] for name in names} for names in modules_after(*steps)]


# The last step shows each time that what the others have not loaded would be seen.
def test_each_part_loads_no_more_than_it_needs() -> None:
    package, inference, training, more = loaded_by(
        "import pix2face",
        "import pix2face.inference.predictor",
        "import training.train_cli",
        "import datagen.opengl.gl_context",
    )
    assert not package & {"torch", "h5py", "numpy", "cv2"}
    assert {"onnxruntime", "numpy"} <= inference
    assert not inference & INFERENCE_NEEDS_NO
    assert {"training", "torch", "h5py"} <= training
    assert not training & TRAINING_NEEDS_NO
    assert {"moderngl", "datagen"} <= more & TRAINING_NEEDS_NO


def test_photographs_load_no_more_than_they_need_and_no_module_of_datagen_loads_torch() -> None:
    write = """
import tempfile
from pathlib import Path
from pix2face.files.meshes.ply import encode_ply
from pix2face.models.morphable_model import builtin_model
from pix2face.photographs.mesh_files import FaceMesh, write_mesh
model = builtin_model()
colours = model.mean.astype("uint8")
with tempfile.TemporaryDirectory() as folder:
    for suffix in ("obj", "ply", "glb"):
        write_mesh(Path(folder, f"face.{suffix}"), FaceMesh(model.mean, model, colours))
    Path(folder, "points.ply").write_bytes(encode_ply(model.mean, colours))
"""
    assert {"datagen.cli", "datagen.rendering.renderer", "datagen.appearance.scene"} <= set(DATAGEN_MODULES)
    predicting, fitting, viewing, written, rendering, more = modules_after(
        "import pix2face.commands.predict_cli",
        "import pix2face.commands.fit_cli",
        "import pix2face.commands.view_cli",
        write,
        f"import {', '.join(DATAGEN_MODULES)}",
        "import trimesh, scipy.optimize, training.loop.losses",
    )
    assert "scipy.linalg" in predicting
    assert not predicting & (PHOTOGRAPHS_NEED_NO | {"scipy.spatial"})
    assert "scipy.spatial" in fitting
    assert not fitting & PHOTOGRAPHS_NEED_NO
    assert not viewing & PHOTOGRAPHS_NEED_NO
    assert not written & PHOTOGRAPHS_NEED_NO
    assert "moderngl" in rendering
    assert not rendering & {"torch", "training"}
    assert {"trimesh", "networkx", "scipy.optimize", "torch"} <= more & PHOTOGRAPHS_NEED_NO
    assert "training" in more


def test_help_loads_nothing_heavy() -> None:
    def help_of(pages: list[str]) -> str:
        calls = [(PROGRAMS[program].__module__, words) for program, *words in map(str.split, pages)]
        return f"""
import contextlib, importlib, io
for module, words in {calls}:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        importlib.import_module(module).main([*words, "--help"])
"""

    of_training = [page for page in PAGES if page.startswith("train")]
    light, helped, more = loaded_by(
        help_of([page for page in PAGES if page not in of_training]),
        help_of(of_training),
        "import pix2face.shards.shard_reader",
    )
    assert {"tyro", "datagen", "pix2face"} <= light
    assert not light & {"numpy", "cv2", "jaxtyping"}
    assert {"training", "numpy"} <= helped
    assert not helped & HELP_NEEDS_NO
    assert "h5py" in more & HELP_NEEDS_NO


def test_broken_contracts_would_be_seen(tmp_path: Path) -> None:
    """That ``make layers`` can fail."""
    broken = [
        ("pix2face/geometry/camera.py", "training.loop.losses"),
        ("datagen/sampling/faces.py", "torch"),
        ("training/loop/losses.py", "moderngl"),
        ("training/loop/losses.py", "datagen.sampling.faces"),
        ("pix2face/models/rasterise.py", "torch"),
    ]
    for package in ("pix2face", "datagen", "training"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("assets", "__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for path, imported in broken:
        with (tmp_path / path).open("a") as file:
            file.write(f"\nimport {imported}\n")
    program = shutil.which("lint-imports", path=str(Path(sys.executable).parent)) or shutil.which("lint-imports")
    assert program is not None, "import-linter is not installed: pip install -e '.[dev]'"
    run = subprocess.run([program, "--no-cache"], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode != 0
    assert "0 broken" not in run.stdout
    for path, imported in broken:
        importer = path.removesuffix(".py").replace("/", ".")
        assert f"{importer} -> {imported}" in run.stdout
