"""What it costs to draw scenes: people of the preset ``default``, at 256 px, on one core, by stage.

    python -m tests.benchmarks.scene [--n 40] [--size 256] [--preset default] [--out out/scene.json]

Prints and writes JSON: milliseconds of processor time a picture, by stage, mean and largest tenth; OpenGL draws in the
calling thread and finishes each stage before the next begins.
"""

import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from datagen.appearance.appearance import appearance_textures, draw_appearance
from datagen.appearance.appearance_config import AppearanceConfig, load_configuration
from datagen.appearance.light.shading import head_occlusion
from datagen.appearance.scene import Scene
from datagen.appearance.scene_making import SceneMaker
from datagen.appearance.skin.zones import head_paint
from datagen.opengl.gl_context import create_gl_context
from datagen.rendering.scenes import scene_drawing
from datagen.rendering.scenes.scene_drawing import SceneDrawer
from datagen.rendering.scenes.scene_head import SceneHead
from datagen.rendering.scenes.scene_meshes import ObjectMeshes
from datagen.rendering.scenes.scene_targets import SceneTarget
from datagen.sampling.faces import sample_faces
from pix2face.face_files.coefficients import Face
from pix2face.geometry.camera import Camera
from pix2face.models.morphable_model import MorphableModel, builtin_model
from tests.benchmarks.measuring import StepTimes, options_parser, write_report

STAGES = (
    ("upload head", SceneHead, "load"),
    ("upload objects", ObjectMeshes, "load"),
    ("sort transparent objects", ObjectMeshes, "blended"),
    ("shadow maps", SceneDrawer, "_draw_shadows"),
    ("what is seen", SceneDrawer, "_see"),
    ("edges", SceneDrawer, "_find_edges"),
    ("clear, upload", SceneTarget, "clear"),
    ("transparent objects", SceneDrawer, "_draw_blended"),
    ("head and opaque objects", SceneDrawer, "_draw_opaque"),
    ("picture", scene_drawing, "resolve"),
)
WARM_UP = 6


def scenes(model: MorphableModel, config: AppearanceConfig, n: int, size_px: int) -> Iterator[tuple[Scene, Camera]]:
    """Scenes of n people, as ``datagen render`` makes them."""
    maker = SceneMaker(model)
    table = sample_faces(model, n, 7, size_px, geometry=config.geometry)
    for index in range(n):
        face: Face = table.face(index, Path())
        vertices = model.vertices(face.identity[None], face.expression[None])[0]
        yield maker.scene(draw_appearance(7, f"sample {index}", config), face, vertices), face.camera


def measure(n: int, size_px: int, preset: str) -> dict[str, object]:
    """Draws n scenes after some that do not count."""
    model = builtin_model()
    made = list(scenes(model, load_configuration(preset), n + WARM_UP, size_px))
    totals: list[float] = []
    with create_gl_context() as gl:
        drawer = SceneDrawer(model, gl, appearance_textures(), head_paint(model), head_occlusion(model))
        times = StepTimes(time.process_time, gl.context.finish)
        with times.of(STAGES):
            for index, (scene, camera) in enumerate(made):
                if index == WARM_UP:
                    times.seconds.clear()
                    totals.clear()
                started = time.process_time()
                drawer.draw(scene, camera, size_px, size_px)
                totals.append(time.process_time() - started)
    triangles = [sum(len(mesh.triangles) for mesh in scene.meshes) for scene, _ in made[WARM_UP:]]
    stages = {name: _summary(values) for name, values in times.seconds.items()}
    return {
        "pictures": n,
        "size_px": size_px,
        "preset": preset,
        "triangles_beside_the_head": {"mean": float(np.mean(triangles)), "largest": int(max(triangles))},
        "cpu_ms_by_stage": stages,
        "cpu_ms": _summary(totals),
    }


def _summary(seconds: Sequence[float]) -> dict[str, float]:
    values = 1e3 * np.array(seconds)
    return {
        name: round(float(found), 2)
        for name, found in (
            ("mean", values.mean()),
            ("median", np.median(values)),
            ("nine tenths below", np.quantile(values, 0.9)),
        )
    }


def main() -> None:
    """Measures and writes."""
    parser = options_parser(__doc__, Path("out/scene.json"))
    parser.add_argument("--n", type=int, default=40)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--preset", default="default")
    options = parser.parse_args()
    os.environ["LP_NUM_THREADS"] = "0"  # before the driver is loaded
    result = measure(options.n, options.size, options.preset)
    write_report(result, options.out)


if __name__ == "__main__":
    main()
