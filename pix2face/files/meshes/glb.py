"""The file ``.glb``: the tree of a glTF scene as JSON, and the arrays that it refers to by their number.

Source: glTF 2.0 specification, Chapters 3.6, 4.4 and 5.
"""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, final

import numpy as np
from numpy import ndarray

GLB_MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
VERTEX_DATA, INDICES = 34962, 34963

Shape = Literal["SCALAR", "VEC2", "VEC3", "VEC4"]
COLUMNS: Mapping[Shape, int] = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
COMPONENT_TYPES = {"<f4": 5126, "<u4": 5125, "|u1": 5121}


@final
@dataclass(eq=False)
class GlbContent:
    """The binary part of a file, and where its arrays are."""

    binary: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def add(self, values: ndarray, shape: Shape, target: int | None = None) -> int:
        """Appends an array, one element a row; returns the number of its accessor.

        Bytes stay bytes, and stand for 0 to 1, as colours do. Other numbers are stored in 32 bits.
        """
        is_bytes = values.dtype == np.uint8
        kind = "|u1" if is_bytes else "<u4" if values.dtype.kind in "iu" else "<f4"
        flat = values.astype(kind).reshape(-1, COLUMNS[shape])
        self.accessors.append(
            {
                "bufferView": self.add_bytes(flat.tobytes(), target),
                "componentType": COMPONENT_TYPES[kind],
                "count": len(flat),
                "type": shape,
                "min": flat.min(axis=0).tolist(),
                "max": flat.max(axis=0).tolist(),
                **({"normalized": True} if is_bytes else {}),
            }
        )
        return len(self.accessors) - 1

    def add_bytes(self, content: bytes, target: int | None = None) -> int:
        """Appends bytes, such as a picture; returns the number of their view."""
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content)}
        self.views.append(view if target is None else view | {"target": target})
        self.binary += content + bytes(-len(content) % 4)  # arrays begin at multiples of four bytes
        return len(self.views) - 1

    def file(self, tree: Mapping[str, Any]) -> bytes:
        """The whole file: a tree, and what it refers to."""
        whole = {
            **tree,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.binary)}],
        }
        text = json.dumps(whole, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<III", GLB_MAGIC, 2, 28 + len(text) + len(self.binary))
        chunks = struct.pack("<II", len(text), JSON_CHUNK), text, struct.pack("<II", len(self.binary), BINARY_CHUNK)
        return b"".join((head, *chunks, self.binary))
