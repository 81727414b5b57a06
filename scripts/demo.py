"""Renders faces, trains a network, measures it on held-out renders, reads a photograph, and writes report.html.

The photograph is read twice: by the network that the demo trains for two minutes, and by the packaged one. All steps
are commands of the project, which are printed as they run and listed on the page.
"""

import argparse
import html
import json
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import trimesh
from skimage.data import astronaut

# Programs of this installation, independent of PATH.
PROGRAMS = Path(sys.executable).parent
# A folder that contains this file may be replaced.
MARKER = "made_by_demo.txt"
STYLE = """
body { font-family: sans-serif; margin: 2em auto; max-width: 75em; color: #222; line-height: 1.45; }
img { max-width: 100%; } img.maps { width: 48em; }
code { background: #f2f2f2; padding: .1em .3em; } figcaption { color: #555; }
table { border-collapse: collapse; } caption { text-align: left; color: #555; padding: .3em 0; }
th, td { padding: .3em .8em; border-bottom: 1px solid #ccc; text-align: right; }
th:first-child, td:first-child { text-align: left; }
"""


@dataclass
class Demo:
    """Runs commands and measures their times."""

    out: Path
    timings: list[tuple[str, float]] = field(default_factory=list)

    def run(self, program: str, *arguments: object) -> None:
        """Runs one command of the project; its messages go to the terminal."""
        words = [program, *map(str, arguments)]
        print(f"\n$ {shlex.join(words)}", flush=True)
        start = time.monotonic()
        subprocess.run([PROGRAMS / program, *words[1:]], check=True)
        self.timings.append((shlex.join(words), time.monotonic() - start))


def main() -> int:
    """Runs the demo."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("demo"))
    parser.add_argument("--faces", type=int, default=400, help="triplets to train on")
    parser.add_argument("--train-options", default="", help="further options for train, e.g. '--epochs 1'")
    options = parser.parse_args()
    out: Path = options.out
    if out.exists() and any(out.iterdir()) and not (out / MARKER).is_file():
        parser.error(f"--out {out}: not empty and not made by this demo; choose another folder")
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    (out / MARKER).write_text("Made by scripts/demo.py, which replaces this folder when it runs again.\n")
    demo = Demo(out)
    try:
        render_and_train(demo, options.faces, shlex.split(options.train_options))
        measure_and_fit(demo)
    except subprocess.CalledProcessError as error:
        print(f"demo: {Path(error.cmd[0]).name} ended with status {error.returncode}; its message is above")
        return 1
    plot_losses(out / "run" / "log.jsonl", out / "losses.png")
    plot_point_cloud(out / "photograph" / "astronaut-0-points.ply", out / "point_cloud.png")
    (out / "report.html").write_text(page(demo, options.faces), encoding="utf-8")
    print(f"\n{sum(seconds for _, seconds in demo.timings):.0f} s in all; open {out / 'report.html'}")
    return 0


def render_and_train(demo: Demo, n_faces: int, train_options: list[str]) -> None:
    """Makes ground truth, contact sheets and a checkpoint."""
    out = demo.out
    for name, n, seed in (("train", n_faces, 0), ("heldout", 100, 1_000_000)):
        drawn = ["--appearance", "plain", "--out", out / f"{name}.h5"]  # simple enough for some minutes of training
        demo.run("datagen", "sample", "--n", n, "--seed", seed, *drawn)
        layers = ["--appearance", "plain", "--layers", "image,pncc,offset,mask,depth,landmarks"]
        demo.run("datagen", "render", "--coeffs", out / f"{name}.h5", "--out", out / f"shards-{name}", *layers)
    demo.run("datagen", "preview", out / "shards-train", "--n", 12, "--out", out / "contact_sheet.jpg")
    synthetic = out / "synthetic.h5"
    demo.run("datagen", "sample", "--n", 12, "--seed", 4, "--out", synthetic)
    demo.run("datagen", "render", "--coeffs", synthetic, "--out", out / "shards-synthetic")
    demo.run("datagen", "preview", out / "shards-synthetic", "--n", 12, "--out", out / "synthetic.jpg")
    demo.run("train", "--shards", out / "shards-train", "--preset", "tiny", "--out", out / "run", *train_options)


def measure_and_fit(demo: Demo) -> None:
    """Evaluates the demo's network on held-out faces, and fits a photograph with this network and the packaged one."""
    out, checkpoint = demo.out, demo.out / "run" / "checkpoint.safetensors"
    split = ("--split", "builtin-heldout", "--data", out / "shards-heldout")
    demo.run("evaluate", *split, "--checkpoint", checkpoint, "--out", out / "evaluation")
    photograph = out / "astronaut.png"
    cv2.imwrite(str(photograph), astronaut()[..., ::-1])  # type: ignore[no-untyped-call]
    demo.run("pix2face", "fit", photograph, "--largest", "--checkpoint", checkpoint, "--out", out / "own")
    demo.run("pix2face", "fit", photograph, "--largest", "--out", out / "photograph")


def plot_losses(log: Path, picture: Path) -> None:
    """Plots the two parts of the loss."""
    lines = [line for line in map(json.loads, log.read_text().splitlines()) if "loss" in line]  # without validations
    mpl.use("Agg")
    figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
    for name in ("pncc", "offset"):
        axes.semilogy([line["samples"] for line in lines], [line[name] for line in lines], label=name)
    axes.set(xlabel="samples seen", ylabel="loss: mean absolute error,\nin units of the map's scale")
    axes.legend()
    axes.grid(alpha=0.3)
    figure.savefig(picture, dpi=110)
    plt.close(figure)


def plot_point_cloud(cloud: Path, picture: Path) -> None:
    """Plots the predicted points from the front and from both sides."""
    loaded = trimesh.load(cloud)
    points, colours = np.asarray(loaded.vertices), np.asarray(loaded.colors)[:, :3] / 255
    figure, all_axes = plt.subplots(1, 3, figsize=(9, 3.4), layout="constrained")
    for axes, yaw in zip(all_axes, np.radians([-55, 0, 55]), strict=True):
        across = points[:, 0] * np.cos(yaw) + points[:, 2] * np.sin(yaw)
        order = np.argsort(points[:, 2] * np.cos(yaw) - points[:, 0] * np.sin(yaw))
        axes.scatter(across[order], points[order, 1], c=colours[order], s=3, linewidths=0)
        axes.set_aspect("equal")
        axes.set_title(f"turned by {np.degrees(yaw):.0f}°", fontsize=9)
        axes.set_xlabel("to the side, mm", fontsize=8)
    all_axes[0].set_ylabel("up, mm", fontsize=8)
    figure.savefig(picture, dpi=110)
    plt.close(figure)


def page(demo: Demo, n_faces: int) -> str:
    """Returns the page with commands and results."""
    evaluation = (demo.out / "evaluation" / "index.html").read_text(encoding="utf-8")
    table = evaluation[evaluation.index("<table>") : evaluation.index("</table>") + len("</table>")]
    figures = [
        (
            "contact_sheet.jpg",
            "Ground truth of each sample: picture, the point of the mean face at each pixel (PNCC) over it, the offset "
            "from that point, depth, and landmarks (green: visible, red: hidden).",
        ),
        ("losses.png", "The two parts of the training loss, by the number of samples seen."),
        ("synthetic.jpg", "Samples like those that the packaged network was trained on: people who do not exist."),
        (
            "photograph/astronaut-0-maps.png",
            "A photograph and the maps that the packaged network predicts: crop, PNCC, offset (x, y, z as red, green, "
            "blue; ±120 mm and ±15 mm).",
        ),
        ("photograph/astronaut-0-overlay.jpg", "The face that was fitted to these maps, with its landmarks."),
        ("point_cloud.png", "The predicted point cloud: PNCC plus offset at every pixel of the face."),
        (
            "own/astronaut-0-overlay.jpg",
            "The same photograph, fitted with the demo's network, which was trained on plain heads only.",
        ),
        ("evaluation/curve.png", "The demo's network on held-out renders: share of faces by error."),
        ("evaluation/worst.jpg", "The demo's network on held-out renders: the worst cases."),
    ]
    shown = "".join(
        f'<figure><img {"class=maps" if "maps" in name else ""} src="{html.escape(name)}" alt="">'
        f"<figcaption>{html.escape(text)}</figcaption></figure>"
        for name, text in figures
    )
    rows = "".join(
        f"<tr><td><code>{html.escape(command)}</code></td><td>{seconds:.1f}</td></tr>"
        for command, seconds in demo.timings
    )
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>pix2face: demo</title><style>{STYLE}</style></head><body>
<h1>pix2face: coefficients to a trained, evaluated model</h1>
<p>The demo's network was trained for about two minutes on {n_faces} rendered faces of the built-in model. It is far
from converged, but shows that every step works. The packaged network was trained on synthetic photographs for hours
(docs/explanation/packaged_network.md). Both read the photograph.</p>
<h2>Commands</h2>
<table><caption>All commands in their order, and their times.</caption>
<thead><tr><th>command</th><th>time, seconds</th></tr></thead><tbody>{rows}</tbody></table>
<h2>Error on held-out renders</h2>{table}
<p>Row network: the demo's network. Row baseline: landmarks of the mean face, placed in the box of the true ones.</p>
{shown}
<p>Files: <a href="evaluation/report.json">report.json</a>, <a href="photograph/astronaut-0.json">fit</a>,
<a href="photograph/astronaut-0.glb">mesh</a>, <a href="photograph/astronaut-0-points.ply">point cloud</a>.</p>
</body></html>
"""


if __name__ == "__main__":
    sys.exit(main())
