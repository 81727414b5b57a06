"""Finds the faces in a photograph and says where they look; writes landmarks, a mesh of each, and a picture.

python examples/fit_photograph.py PHOTO [--checkpoint C] [--out DIR]

Without --checkpoint the packaged one is taken.
"""

import argparse
from pathlib import Path

import numpy as np

from pix2face import Pix2Face
from pix2face.errors import Pix2FaceError
from pix2face.files.images import encode_image, read_photograph
from pix2face.geometry.camera import head_pose
from pix2face.photographs.fit_pictures import draw_landmarks
from pix2face.photographs.mesh_files import FaceMesh, write_mesh
from pix2face.photographs.texture import vertex_colours


def main(photograph: Path, checkpoint: Path | None, out: Path) -> None:
    """Fits every face of a photograph."""
    image = read_photograph(photograph)  # (height, width, 3) uint8, RGB, as people see it
    pix2face = Pix2Face.load(checkpoint)
    out.mkdir(parents=True, exist_ok=True)
    picture = image
    for index, fit in enumerate(pix2face.fit(image)):
        pose = head_pose(fit.camera)
        print(f"face {index}: yaw {pose.yaw_deg:.0f}, pitch {pose.pitch_deg:.0f}, roll {pose.roll_deg:.0f} degrees")
        # (68, 2) pixels of the photograph, x right, y down, pixel centres at +0.5
        np.savetxt(out / f"landmarks-{index}.csv", fit.landmarks2d, "%.2f", ",", header="x_px,y_px", comments="")
        colours = vertex_colours(image, fit, pix2face.model)
        write_mesh(out / f"face-{index}.ply", FaceMesh(fit.vertices, pix2face.model, vertex_colours=colours))
        picture = draw_landmarks(picture, fit.landmarks2d)
    (out / "landmarks.png").write_bytes(encode_image(picture))
    print(f"-> {out}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photograph", type=Path)
    parser.add_argument("--checkpoint", type=Path)
    parser.add_argument("--out", type=Path, default=Path("out/example"))
    options = parser.parse_args()
    try:
        main(options.photograph, options.checkpoint, options.out)
    except Pix2FaceError as error:  # no checkpoint, no photograph, ...: the message says what to do
        parser.exit(2, f"{error}\n")
