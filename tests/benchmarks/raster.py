"""How fast maps are rasterised: python -m tests.benchmarks.raster --out raster.json.

Both rasterisers draw both maps of one face after the other, in turns, in one process with one thread of the driver, on
a stand-in of BFM's size and on the built-in model, at 256 and 450 pixels; with where the time goes, how it grows with
samples and pixels, and what threads and processes make of it. A fixed NumPy kernel is timed between them, so that runs
on other machines compare as ratios. Times are of the processor (all threads of the process), the least and the median.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time

if __name__ == "__main__":  # read when the driver is loaded
    os.environ.setdefault("LP_NUM_THREADS", "0")

import numpy as np
from numpy import ndarray

from datagen.opengl.gl_context import GLContext, create_gl_context
from datagen.rendering.renderer import Renderer
from datagen.rendering.screen_projection import project_to_screen
from pix2face.geometry.camera import Camera, HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.models.morphable_model import MorphableModel, builtin_model
from tests.benchmarks.surroundings import surroundings, write_report
from tests.meshes import mesh_model, sheet

RASTERISERS = ("compute", "fragment")
SIZES_PX = (256, 450)
HEAD_MM = 250.0


def stand_in() -> MorphableModel:
    """53,240 vertices and 105,600 triangles: a smooth head from ear to ear, with the density of BFM's mean."""
    points, triangles = sheet(241, 219)
    angle, height = (points[:, 0] - 0.5) * np.deg2rad(230), points[:, 1] - 0.5
    across = np.sqrt(np.maximum(1 - (1.6 * height) ** 2, 0.05))
    nose = 22 * np.exp(-((angle / 0.13) ** 2) - ((height + 0.02) / 0.1) ** 2)
    radius = 84 * across + nose
    return mesh_model(
        np.stack([radius * np.sin(angle), 210 * height, 1.15 * radius * np.cos(angle)], axis=1), triangles
    )


def bfm_mean(folder: Path) -> MorphableModel:
    """The mean face of the Basel Face Model as public tools carry it."""
    import scipy.io

    arrays = [np.load(folder / name, allow_pickle=False) for name in ("u_shp.npy", "u_exp.npy")]
    corners = scipy.io.loadmat(folder / "model_info.mat", variable_names=["tri"])["tri"].T.astype(np.int32) - 1
    return replace(mesh_model((arrays[0] + arrays[1]).reshape(-1, 3) / 1000, corners[:, [0, 2, 1]]), name="BFM's mean")


def camera_for(size_px: int) -> Camera:
    """Looks at a head, turned a little, that fills the picture as that of 300W-LP does."""
    rotation = rotation_of_pose(HeadPose(0, 20, 0))
    return weak_perspective_camera(WeakPerspective(size_px / HEAD_MM, rotation, np.full(2, size_px / 2)))


def reference_kernel() -> None:
    """A fixed amount of arithmetic and of memory traffic."""
    values = np.linspace(0, 1, 1 << 18, dtype=np.float32)
    for _ in range(4):
        values = np.sqrt(values * values + np.float32(0.5))
    np.sort(values)


def milliseconds(work: dict[str, Callable[[], object]], repeats: int) -> dict[str, dict[str, float]]:
    """Least and median time of the processor for each, taken in turns."""
    seconds: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(repeats):
        for name, call in work.items():
            start = process_time()
            call()
            seconds[name].append(process_time() - start)
    return {name: {"least": 1e3 * min(s), "median": 1e3 * float(np.median(s))} for name, s in seconds.items()}


def stages(renderer: Renderer, vertices: ndarray, camera: Camera, repeats: int) -> dict[str, float]:
    """Least time of each step of one rendering, with a wait for the driver after each."""
    scene, size = renderer._scene, (renderer.height, renderer.width)
    finish = scene.gl.context.finish
    projection = project_to_screen(camera, vertices, *size)

    def waited(call: Callable[[], object]) -> Callable[[], object]:
        return lambda: (call(), finish())

    steps = {
        "project": lambda: project_to_screen(camera, vertices, *size),
        "upload": waited(lambda: scene.mesh.load(projection)),
        "rasterise": waited(lambda: scene.rasteriser.see(projection, *size)),
        "interpolate, read back": waited(lambda: scene.maps.draw(projection, *size, False)),
    }
    return {name: time["least"] for name, time in milliseconds(steps, repeats).items()}


def measure(model: MorphableModel, gl: GLContext, repeats: int) -> list[dict[str, object]]:
    """Both rasterisers on one model, in turns."""
    rows: list[dict[str, object]] = []
    vertices = model.mean + np.float32(0.1)
    renderers = {name: Renderer(model, 16, 16, gl, name) for name in RASTERISERS}
    for size in SIZES_PX:
        sized = {name: renderer.with_size(size, size) for name, renderer in renderers.items()}
        work = {name: lambda r=r, size=size: r.render(vertices, camera_for(size)) for name, r in sized.items()}
        total = milliseconds({**work, "reference": reference_kernel}, repeats)
        parts = {name: stages(r, vertices, camera_for(size), repeats) for name, r in sized.items()}
        rows.append(
            {
                "model": model.name,
                "vertices": len(model.mean),
                "triangles": len(model.triangles),
                "size_px": size,
                "face_pixels": int(sized["compute"].render(vertices, camera_for(size))["mask"].sum()),
                "render_ms": total,
                "steps_least_ms": parts,
                "render_compute_in_reference_kernels": total["compute"]["least"] / total["reference"]["least"],
                "render_fragment_over_compute": total["fragment"]["least"] / total["compute"]["least"],
                "rasterise_fragment_over_compute": parts["fragment"]["rasterise"] / parts["compute"]["rasterise"],
            }
        )
    return rows


def growth(model: MorphableModel, gl: GLContext, repeats: int) -> dict[str, object]:
    """Time against samples and against pixels; exponents of 1 and less are linear and less."""
    renderer = Renderer(model, 256, 256, gl)

    def draw(n: int, size: int) -> Callable[[], object]:
        sized, camera = renderer.with_size(size, size), camera_for(size)
        return lambda: [sized.render(model.mean, camera) for _ in range(n)]

    samples = {n: draw(n, 256) for n in (4, 8, 16)}
    pixels = {size: draw(4, size) for size in (128, 256, 512)}
    found: dict[str, object] = {}
    for name, calls, amount in (("samples", samples, lambda n: n), ("pixels", pixels, lambda size: size * size)):
        least = {key: t["least"] for key, t in milliseconds({str(k): c for k, c in calls.items()}, repeats).items()}
        x, y = np.log([amount(int(key)) for key in least]), np.log(list(least.values()))
        found[name] = {"ms": least, "exponent": float(np.polyfit(x, y, 1)[0])}
    return found


def drawn_in(seconds: float) -> float:
    """Faces a second of this process on the wall clock, at 450 px."""
    model = stand_in()
    with create_gl_context() as gl:
        renderer = Renderer(model, 450, 450, gl)
        renderer.render(model.mean, camera_for(450))
        start, n = perf_counter(), 0
        while perf_counter() - start < seconds:
            renderer.render(model.mean, camera_for(450))
            n += 1
        return n / (perf_counter() - start)


def threads_and_processes(seconds: float) -> list[dict[str, object]]:
    """Faces a second of several processes with several threads of the driver each."""
    rows: list[dict[str, object]] = []
    for processes, threads in ((1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (2, 2)):
        command = [sys.executable, "-m", "tests.benchmarks.raster", "--worker", str(seconds)]
        environment = {**os.environ, "LP_NUM_THREADS": str(threads)}
        running = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) for _ in range(processes)]
        rates = [float(process.communicate()[0]) for process in running]
        rows.append({"processes": processes, "LP_NUM_THREADS": threads, "faces_per_second": sum(rates)})
    return rows


def main() -> None:
    """Measures and writes JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--bfm-mean", type=Path, help="folder with u_shp.npy, u_exp.npy, model_info.mat: measured too")
    parser.add_argument("--threads", type=float, default=0, help="seconds for each of six choices of threads")
    parser.add_argument("--worker", type=float, help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    if options.worker:
        print(drawn_in(options.worker))  # noqa: T201
        return
    models = [replace(stand_in(), name="stand-in of BFM's size"), builtin_model()]
    if options.bfm_mean:
        models.append(bfm_mean(options.bfm_mean))
    with create_gl_context() as gl:
        result: dict[str, object] = {
            "rows": [row for model in models for row in measure(model, gl, options.repeats)],
            "growth": growth(models[0], gl, max(3, options.repeats // 3)),
            "threads": threads_and_processes(options.threads) if options.threads else [],
            "renderer": gl.renderer,
            "opengl": gl.version_code,
            "LP_NUM_THREADS": os.environ.get("LP_NUM_THREADS"),
            "measured_on": surroundings(),
        }
    write_report(result, options.out)


if __name__ == "__main__":
    main()
