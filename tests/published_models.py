"""Files of ours in the layouts of published models, for readers whose models need a licence."""

import pickle
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import h5py
import numpy as np
import scipy.io
import scipy.sparse
from numpy import ndarray

from tests.synthetic_models import small_head_model


@dataclass(frozen=True)
class Head:
    """What a file says, in mm: mean (v, 3), bases (k, v, 3) at one standard deviation, triangles from 0."""

    mean: ndarray
    identity: ndarray
    expression: ndarray
    triangles: ndarray

    def vertices(self, identity: ndarray, expression: ndarray) -> ndarray:
        out = self.mean + np.tensordot(identity, self.identity, axes=1)
        return np.asarray(out + np.tensordot(expression, self.expression, axes=1))


def small_head(n_identity: int = 5, n_expression: int = 3, seed: int = 0) -> Head:
    """The small synthetic head with random components."""
    model, rng = small_head_model(), np.random.default_rng(seed)
    shape = (len(model.mean), 3)
    identity, expression = rng.normal(0, 2, (n_identity, *shape)), rng.normal(0, 3, (n_expression, *shape))
    return Head(np.array(model.mean, dtype=np.float64), identity, expression, np.array(model.triangles))


def tiny_solid(n_identity: int = 2, n_expression: int = 2) -> Head:
    """An octahedron: a model of a few hundred bytes, for what is done to it thousands of times."""
    rng = np.random.default_rng(1)
    mean = 80.0 * np.concatenate([np.eye(3), -np.eye(3)])
    triangles = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    return Head(mean, rng.normal(0, 2, (n_identity, 6, 3)), rng.normal(0, 2, (n_expression, 6, 3)), triangles)


def write_flame(path: Path, head: Head, *, chumpy: bool = True, protocol: int = 2) -> Path:
    """A pickle in FLAME's layout: metres, 300 + 100 components, chumpy containers and a sparse regressor."""
    n = len(head.mean)
    directions = np.zeros((n, 3, 400))
    directions[:, :, : len(head.identity)] = head.identity.transpose(1, 2, 0) / 1000
    directions[:, :, 300 : 300 + len(head.expression)] = head.expression.transpose(1, 2, 0) / 1000
    with chumpy_modules() as containers:
        wrap = containers.Ch if chumpy else np.asarray
        fields: dict[str, Any] = {
            "v_template": wrap(head.mean / 1000),
            "f": head.triangles.astype(np.uint32),
            "shapedirs": wrap(directions),
            "J_regressor": scipy.sparse.csc_matrix(np.eye(5, n)),
            "kintree_table": np.array([[4294967295, 0, 1, 1, 1], [0, 1, 2, 3, 4]], dtype=np.uint32),
            "bs_style": "lbs",
        }
        path.write_bytes(pickle.dumps(fields, protocol=protocol))
    return path


@contextmanager
def chumpy_modules() -> Iterator[Any]:
    """Stands in for chumpy while a pickle is written, and is gone before it is read."""

    class Ch:
        def __init__(self, x: ndarray) -> None:
            self.x = x
            self._dirty_vars: set[str] = set()

    class Select:
        def __init__(self, a: Ch, idxs: ndarray, preferred_shape: tuple[int, ...]) -> None:
            self.a, self.idxs, self.preferred_shape = a, idxs, preferred_shape

    modules = {name: ModuleType(name) for name in ("chumpy", "chumpy.ch", "chumpy.reordering")}
    for module, kind in (("chumpy.ch", Ch), ("chumpy.reordering", Select)):
        kind.__module__, kind.__qualname__ = module, kind.__name__
        setattr(modules[module], kind.__name__, kind)
    holder = ModuleType("containers")
    holder.Ch, holder.Select = Ch, Select  # type: ignore[attr-defined]
    sys.modules.update(modules)
    try:
        yield holder
    finally:
        for name in modules:
            del sys.modules[name]


def write_gnm(path: Path, head: Head, *, quads: ndarray | None = None, compressed: bool = False) -> Path:
    """An archive in GNM's layout: metres."""
    arrays: dict[str, Any] = {
        "template_vertex_positions": (head.mean / 1000).astype(np.float32),
        "vertex_identity_basis": (head.identity / 1000).astype(np.float32),
        "expression_basis": (head.expression / 1000).astype(np.float32),
        "triangles": head.triangles.astype(np.int32),
        "identity_names": np.array([f"head_{i:03d}" for i in range(len(head.identity))]),
    }
    if quads is not None:
        arrays["quads"] = quads
    (np.savez_compressed if compressed else np.savez)(path, **arrays)
    return path


def write_surrey(folder: Path, head: Head, *, colour: bool = False, version: int = 1, expression: str = "") -> Path:
    """A model file and its blendshapes in Surrey's layout: unit-norm columns, variances, little-endian.

    From version 2 on, the model file itself has no expressions, or those of a "pca" model, or "blendshapes".
    """
    n = head.mean.size
    out = struct.pack("<I", version) + _eos_pca(head.mean, head.identity, head.triangles)
    if colour:
        out += _matrix(np.full((n, 1), 0.5)) + _matrix(np.full((n, 1), 0.25)) + _matrix(np.array([[4.0]]))
    else:
        out += _matrix(np.zeros((0, 0))) * 3
    out += _triangles(np.zeros((0, 3)))
    shapes = struct.pack("<Q", len(head.expression))
    for i, shape in enumerate(head.expression):
        shapes += _eos_text(f"shape {i}") + _matrix(shape.reshape(n, 1))
    if version >= 2:
        models = {"": b"", "blendshapes": struct.pack("<i", 1) + shapes}
        models["pca"] = struct.pack("<i", 0) + _eos_pca(np.full_like(head.mean, 2.0), head.expression, head.triangles)
        out += bytes([not expression]) + models[expression]
    if version >= 3:  # two landmarks
        out += b"\0" + struct.pack("<Q", 2) + _eos_text("chin") + struct.pack("<i", 0)
        out += _eos_text("9") + struct.pack("<i", 1)
    uv = np.linspace(0, 1, 2 * len(head.mean)).reshape(-1, 2)
    out += struct.pack("<Q", len(uv)) + uv.astype("<f8").tobytes()
    if version >= 4:
        out += _triangles(head.triangles)
    (folder / "expression_blendshapes.bin").write_bytes(shapes)
    (folder / "model.bin").write_bytes(out)
    return folder / "model.bin"


def write_ict(folder: Path, head: Head) -> Path:
    """OBJ files in the layout of ICT-FaceKit: cm, one file a shape; eyelashes as a transparent shell."""
    inside = folder / "FaceXModel"
    inside.mkdir()
    faces = [" ".join(f"{corner + 1}/{corner + 1}" for corner in row) for row in head.triangles]
    lines = [f"vt {i / len(head.mean):.6f} 0.25" for i in range(len(head.mean))]
    lines += ["usemtl M_Face", *(f"f {face}" for face in faces[2:]), "usemtl M_BackHead", f"f {faces[1]}"]
    lines += ["usemtl M_EyeLashes", f"f {faces[0]}"]
    shapes = {"generic_neutral_mesh": head.mean}
    shapes |= {f"identity{i:03d}": head.mean + shape for i, shape in enumerate(head.identity)}
    shapes |= {f"smile{i}": head.mean + shape for i, shape in enumerate(head.expression)}
    for name, vertices in shapes.items():
        rows = ["v " + " ".join(f"{value:.7f}" for value in vertex / 10) for vertex in vertices]
        (inside / f"{name}.obj").write_text("\n".join(["# ours", *rows, *lines, ""]))
    return folder


def write_statismo(
    path: Path, head: Head, *, expression_mean: ndarray | None = None, landmarks: str = "", unit_m: float | None = None
) -> Path:
    """A file in the layout of BFM 2017: variances, transposed points and cells, colours."""
    unit = 1.0 if unit_m is None else unit_m * 1000
    offset = np.zeros_like(head.mean) if expression_mean is None else expression_mean
    with h5py.File(path, "w") as file:
        _part(file, "shape", (head.mean - offset) / unit, head.identity / unit)
        _part(file, "expression", offset / unit, head.expression / unit)
        _part(file, "color", np.full_like(head.mean, 0.5), np.full((1, *head.mean.shape), 0.1))
        file["shape/representer/points"] = (head.mean.T / unit).astype(np.float32)
        file["shape/representer/cells"] = head.triangles.T.astype(np.uint32)
        if unit_m is not None:
            file["shape/representer/length-unit"] = np.float32(unit_m)
        if landmarks:
            file["metadata/landmarks/json"] = np.array([landmarks.encode()])
    return path


def write_bfm(
    folder: Path,
    head: Head,
    keypoints: ndarray,
    *,
    expression_mean: ndarray | None = None,
    inward: bool = True,
    dtype: type = np.float64,
    compressed: bool = False,
) -> Path:
    """Model_Shape.mat and Model_Expression.mat: µm, 1-based, wound inward, columns apart from their deviations."""
    n = head.mean.size
    offset = np.zeros((n, 1)) if expression_mean is None else 1000 * expression_mean.reshape(n, 1)
    identity_unit = np.linspace(9e5, 1e5, len(head.identity))[:, None]
    expression_unit = np.linspace(2, 0.2, len(head.expression))[:, None]
    triangles = head.triangles[:, [0, 2, 1]] if inward else head.triangles
    shape = {
        "mu_shape": (1000 * head.mean.reshape(n, 1) - offset).astype(dtype),
        "w": (1000 * head.identity.reshape(-1, n).astype(dtype) / identity_unit.astype(dtype)).T,
        "sigma": identity_unit,
        "tri": triangles.T + 1,
        "keypoints": keypoints[None] + 1,
    }
    expression = {
        "mu_exp": offset.astype(dtype),
        "w_exp": (1000 * head.expression.reshape(-1, n).astype(dtype) / expression_unit.astype(dtype)).T,
        "sigma_exp": expression_unit,
    }
    scipy.io.savemat(folder / "Model_Shape.mat", shape, do_compression=compressed)
    scipy.io.savemat(folder / "Model_Expression.mat", expression, do_compression=compressed)
    return folder


def write_original_bfm(folder: Path, head: Head, *, dtype: type = np.float64) -> Path:
    """01_MorphableModel.mat with an albedo of one component: µm, 1-based, wound inward, colours 0..255."""
    n = head.mean.size
    deviations = np.linspace(9e5, 1e5, len(head.identity))[:, None]
    fields = {
        "shapeMU": (1000 * head.mean.reshape(n, 1)).astype(dtype),
        "shapePC": (1000 * head.identity.reshape(-1, n).astype(dtype) / deviations.astype(dtype)).T,
        "shapeEV": deviations,
        "tl": head.triangles[:, [0, 2, 1]] + 1,
        "texMU": np.full((n, 1), 51.0),
        "texPC": np.full((n, 1), 0.5),
        "texEV": np.array([[10.2]]),
    }
    scipy.io.savemat(folder / "01_MorphableModel.mat", fields)
    return folder


def write_guo(folder: Path, mean: ndarray, expression: ndarray) -> None:
    """Exp_Pca.bin and std_exp.txt: µm."""
    deviations = np.linspace(2, 0.5, len(expression))
    rows = np.concatenate([mean.reshape(1, -1), expression.reshape(len(expression), -1) / deviations[:, None]]) * 1000
    (folder / "Exp_Pca.bin").write_bytes(struct.pack("<i", len(expression)) + rows.astype("<f4").tobytes())
    (folder / "std_exp.txt").write_text(" ".join(f"{value:.9g}" for value in deviations) + "\n")


def _eos_pca(mean: ndarray, basis: ndarray, triangles: ndarray) -> bytes:
    columns = basis.reshape(len(basis), mean.size).T
    norms = np.linalg.norm(columns, axis=0)
    parts = _matrix(mean.reshape(-1, 1)) + _matrix(columns / norms) + _matrix((norms**2)[:, None])
    return parts + _triangles(triangles)


def _eos_text(text: str) -> bytes:
    return struct.pack("<Q", len(text)) + text.encode()


def _part(file: h5py.File, name: str, mean: ndarray, basis: ndarray) -> None:
    columns = basis.reshape(len(basis), mean.size).T
    norms = np.linalg.norm(columns, axis=0)
    file[f"{name}/model/mean"] = mean.ravel().astype(np.float32)
    file[f"{name}/model/pcaBasis"] = (columns / norms).astype(np.float32)
    file[f"{name}/model/pcaVariance"] = (norms**2).astype(np.float32)


def _matrix(values: ndarray) -> bytes:
    return struct.pack("<ii", *values.shape) + values.T.astype("<f4").tobytes()


def _triangles(triangles: ndarray) -> bytes:
    return struct.pack("<Q", len(triangles)) + triangles.astype("<i4").tobytes()
