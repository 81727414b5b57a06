"""Which samples show the same person, so that nobody is both trained on and held out.

Samples show the same person where their identity coefficients are the same, where they are variants of one face
(``datagen render --jitter``, mirrored ones included), or where they come from one photograph of 300W-LP, which turns
each photograph into several.
"""

import re
from collections.abc import Mapping
from hashlib import blake2b
from typing import final

import numpy as np
from jaxtyping import Float32, UInt64
from numpy import ndarray

from pix2face.shards.sample import JITTER_OF, PICTURE, PictureKind

# Such as AFW/AFW_134212_1_0, AFW_Flip/AFW_134212_1_0, LFPW/LFPW_image_train_0001_3: the last number is of the turn.
_300W_LP_NAME = re.compile(r"(?:.*/)?((?:AFW|HELEN|IBUG|LFPW)_.+)_\d+")
_HASH_BYTES = 8


@final
class PersonGroups:
    """Groups samples by person: samples that share any sign of identity belong together."""

    def __init__(self) -> None:
        self._parent: dict[bytes, bytes] = {}
        self._first: list[bytes] = []

    def add(self, sample_id: str, identity: Float32[ndarray, " k"], attributes: Mapping[str, str | float]) -> None:
        """Takes the next sample."""
        # A sample whose model has no identity components says nothing by having none.
        first = _hash(b"identity", identity.tobytes() if identity.size else sample_id.encode())
        roots = {self._root(first)}
        if JITTER_OF in attributes:
            roots.add(self._root(_hash(b"face", str(attributes[JITTER_OF]).encode())))
        photograph = _300W_LP_NAME.fullmatch(str(attributes.get(JITTER_OF, sample_id)))
        if photograph and attributes.get(PICTURE) == PictureKind.PHOTOGRAPH:
            roots.add(self._root(_hash(b"photograph", photograph[1].encode())))
        smallest = min(roots)
        self._parent |= dict.fromkeys(roots, smallest)
        self._first.append(first)

    def hashes(self) -> UInt64[ndarray, " n"]:
        """For each sample the number of its person, which does not depend on the order of the samples."""
        content = b"".join(self._root(first) for first in self._first)
        return np.frombuffer(content, dtype=">u8").astype(np.uint64)

    def _root(self, key: bytes) -> bytes:
        while self._parent.setdefault(key, key) != key:
            self._parent[key] = self._parent[self._parent[key]]
            key = self._parent[key]
        return key


def _hash(kind: bytes, content: bytes) -> bytes:
    return blake2b(content, digest_size=_HASH_BYTES, person=kind).digest()
