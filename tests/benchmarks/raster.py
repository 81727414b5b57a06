"""How fast maps are rasterised: python -m tests.benchmarks.raster --out raster.json.

The processor, compute shaders (where there is OpenGL) and a plain z-buffer in C++ (where there is g++) draw one face in
turns, in one process with one thread of the driver, on a stand-in of BFM's size and on the built-in model, at 256 and
450 pixels; with where the time goes, and how it grows with samples, pixels and triangles. ``--processes`` adds what one
and two processes draw. Times are of the processor (all threads of the process), the least and the median. A fixed NumPy
kernel is timed in between, so that runs on other machines compare as ratios. The z-buffer draws one map of three bytes
a pixel, without projection; the others both maps, mask and depths in float32, with projection.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

if __name__ == "__main__":  # read when the driver is loaded
    os.environ.setdefault("LP_NUM_THREADS", "0")

import numpy as np
from numpy import ndarray

from datagen.opengl.gl_context import GLContext, create_gl_context
from datagen.rendering.processor.interpolation import draw_maps
from datagen.rendering.processor.processor_maps import ROUNDING, ProcessorMaps, _way_back
from datagen.rendering.processor.visibility import Mesh, Seen, see
from datagen.rendering.renderer import Renderer
from datagen.rendering.screen_projection import project_to_screen
from pix2face.errors import GLUnavailableError
from pix2face.geometry.camera import Camera, HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.models.morphable_model import MorphableModel, builtin_model
from tests.benchmarks.measuring import options_parser, processor_ms, write_report
from tests.benchmarks.z_buffer import ZBuffer
from tests.meshes import mesh_model, sheet

SIZES_PX = (256, 450)
HEAD_MM = 250.0


def stand_in(parts: float = 1) -> MorphableModel:
    """53,240 vertices and 105,600 triangles (times ``parts``): a smooth head, with the density of BFM's mean."""
    points, triangles = sheet(round(241 * parts), 219)
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
    times = processor_ms(work, repeats)
    return {name: {"least": min(own), "median": float(np.median(own))} for name, own in times.items()}


def stages(model: MorphableModel, vertices: ndarray, size_px: int, repeats: int) -> dict[str, float]:
    """Least time of each step of the processor."""
    maps, camera, size = ProcessorMaps(model), camera_for(size_px), (size_px, size_px)
    projection = project_to_screen(camera, vertices, *size)
    mesh = Mesh(projection.screen, maps._triangles)
    seen = Seen(np.empty(size, np.float32), np.empty(size, np.int32))
    drawn, way = maps._empty_maps(size, np.float32, with_weights=False), _way_back(projection)
    margin = ROUNDING * max(map(abs, projection.order_range_mm))
    steps = {
        "project": lambda: project_to_screen(camera, vertices, *size),
        "find triangles": lambda: see(mesh, margin, seen),
        "interpolate": lambda: draw_maps(seen.triangle, mesh, maps._surface, way, 0, drawn),
    }
    return {name: time["least"] for name, time in milliseconds(steps, repeats).items()}


def measure(model: MorphableModel, gl: GLContext | None, repeats: int, folder: Path) -> list[dict[str, object]]:
    """All ways to draw one model, in turns."""
    rows: list[dict[str, object]] = []
    vertices = model.mean + np.float32(0.1)
    renderers = {"processor": Renderer(model, 16, 16)}
    if gl is not None and gl.version_code >= 430:
        renderers["compute"] = Renderer(model, 16, 16, gl, "compute")
    z_buffer = ZBuffer(model.mean, model.triangles, folder) if ZBuffer.is_available() else None
    for size in SIZES_PX:
        camera = camera_for(size)
        sized = {name: renderer.with_size(size, size) for name, renderer in renderers.items()}
        work: dict[str, Callable[[], object]] = {
            name: lambda r=r, camera=camera: r.render(vertices, camera) for name, r in sized.items()
        }
        if z_buffer is not None:
            screen = z_buffer.project(vertices, camera)
            work["z-buffer in C++"] = lambda screen=screen, size=size: z_buffer.draw(screen, size)
        least = milliseconds({**work, "reference": reference_kernel}, repeats)
        of_processor = least["processor"]["least"]
        rows.append(
            {
                "model": model.name,
                "vertices": len(model.mean),
                "triangles": len(model.triangles),
                "size_px": size,
                "face_pixels": int(sized["processor"].render(vertices, camera)["mask"].sum()),
                "render_ms": least,
                "steps_of_processor_least_ms": stages(model, vertices, size, repeats),
                "processor_in_reference_kernels": of_processor / least["reference"]["least"],
                "processor_over_others": {
                    name: of_processor / least[name]["least"] for name in work if name != "processor"
                },
            }
        )
    return rows


def growth(repeats: int) -> dict[str, object]:
    """Time against samples, pixels and triangles; exponents of 1 and less are linear and less."""
    model = stand_in()
    renderer = Renderer(model, 256, 256)

    def draw(n: int, size: int, model: MorphableModel = model) -> Callable[[], object]:
        sized, camera = renderer.with_size(size, size), camera_for(size)
        if model is not renderer.model:
            sized = Renderer(model, size, size)
        return lambda: [sized.render(model.mean, camera) for _ in range(n)]

    amounts: dict[str, dict[int, Callable[[], object]]] = {
        "samples": {n: draw(n, 256) for n in (4, 8, 16)},
        "pixels": {size * size: draw(4, size) for size in (128, 256, 512)},
        "triangles": {len(each.triangles): draw(4, 256, each) for each in (stand_in(parts) for parts in (0.5, 1, 2))},
    }
    found: dict[str, object] = {}
    for name, calls in amounts.items():
        least = [time["least"] for time in milliseconds({str(k): c for k, c in calls.items()}, repeats).values()]
        exponent = float(np.polyfit(np.log(list(calls)), np.log(least), 1)[0])
        found[name] = {"ms": dict(zip(calls, least, strict=True)), "exponent": exponent}
    return found


def drawn_in(seconds: float) -> float:
    """Faces a second of this process on the wall clock, at 450 px."""
    model = stand_in()
    renderer = Renderer(model, 450, 450)
    renderer.render(model.mean, camera_for(450))
    start, n = perf_counter(), 0
    while perf_counter() - start < seconds:
        renderer.render(model.mean, camera_for(450))
        n += 1
    return n / (perf_counter() - start)


def processes(seconds: float) -> dict[str, float]:
    """Faces a second of one and of two processes."""
    rates = []
    for n in (1, 2):
        command = [sys.executable, "-m", "tests.benchmarks.raster", "--worker", str(seconds)]
        running = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(n)]
        rates.append(sum(float(process.communicate()[0]) for process in running))
    return {"1": rates[0], "2": rates[1], "ratio": rates[1] / rates[0]}


def main() -> None:
    """Measures and writes JSON."""
    parser = options_parser(__doc__)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--bfm-mean", type=Path, help="folder with u_shp.npy, u_exp.npy, model_info.mat: measured too")
    parser.add_argument("--processes", type=float, default=0, help="seconds for one and for two processes")
    parser.add_argument("--worker", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(drawn_in(options.worker))  # noqa: T201
        return
    models = [replace(stand_in(), name="stand-in of BFM's size"), builtin_model()]
    if options.bfm_mean:
        models.append(bfm_mean(options.bfm_mean))
    try:
        gl = create_gl_context()
    except GLUnavailableError:
        gl = None
    with TemporaryDirectory() as folder:
        rows = [row for model in models for row in measure(model, gl, options.repeats, Path(folder))]
    result: dict[str, object] = {
        "rows": rows,
        "growth": growth(max(3, options.repeats // 3)),
        "processes": processes(options.processes) if options.processes else {},
        "opengl": f"{gl.renderer}, {gl.version_code}" if gl else "none",
    }
    write_report(result, options.out)


if __name__ == "__main__":
    main()
