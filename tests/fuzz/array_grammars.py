"""Files of arrays: HDF5 and `.npz`, with what their writers made changed."""

import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np

from tests.fuzz.values import JSON_PIECES, LENGTHS, TEXTS, Rng, mutated, one, several, written

DTYPES = ("<f4", "<f8", "<f2", ">i4", "u1", "<i8", "S4", "<c8", "?")


@cache
def originals(write: Callable[[Path], object]) -> dict[str, bytes]:
    """Files without fault by their names in a folder, written once."""
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write(folder)
        files = (path for path in folder.rglob("*") if path.is_file())
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@cache
def packed_zeros(n_bytes: int) -> bytes:
    """Zeros, a thousandth of the size."""
    return zlib.compress(bytes(n_bytes), 1)


def hdf5_of(write_original: Callable[[Path], object], name: str) -> Callable[[Path, Rng], None]:
    """A grammar of HDF5 files around one that is right."""

    def write(path: Path, rng: Rng) -> None:
        path.write_bytes(originals(write_original)[name])
        _change(path, rng)

    return write


def _change(path: Path, rng: Rng) -> None:
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visititems(lambda found, item: names.append(found) if isinstance(item, h5py.Dataset) else None)
        for _ in range(int(rng.integers(4))):
            if rng.random() < 0.25 and file.attrs:
                _change_attribute(file.attrs, rng)
            else:
                _change_dataset(file, one(rng, names), rng)


def _change_attribute(attributes: h5py.AttributeManager, rng: Rng) -> None:
    name = one(rng, sorted(attributes))
    values = (
        np.inf,
        np.nan,
        99,
        -1,
        "words",
        b"",
        np.zeros(3),
        h5py.Empty("f4"),
        np.bytes_(one(rng, TEXTS).encode()),
        np.bytes_(written(one(rng, JSON_PIECES)).encode("utf-8", "replace")[:30_000]),
    )
    del attributes[name]
    if rng.random() < 0.9:
        attributes[name] = one(rng, values)


def _change_dataset(file: h5py.File, name: str, rng: Rng) -> None:  # noqa: C901 (one branch for each kind)
    if not isinstance(file.get(name, getlink=True), h5py.HardLink) or not isinstance(file[name], h5py.Dataset):
        return
    item = file[name]
    attributes, dtype, shape = dict(item.attrs), item.dtype, item.shape or ()
    content = np.asarray(item[()]) if item.size and item.size < 10**6 else None
    del file[name]
    kind, some_shape = int(rng.integers(9)), tuple(int(one(rng, (0, 1, 2, 9, 68, 8192))) for _ in shape)
    if kind == 0:
        return
    if kind == 1:
        file[name] = one(rng, (h5py.SoftLink("/x"), h5py.ExternalLink("/etc/passwd", "/"), h5py.SoftLink(f"/{name}")))
        return
    if kind == 2:
        file.create_group(name)
    elif kind == 3:  # declared, hardly stored
        lengths = tuple(int(one(rng, LENGTHS[:10])) or 1 for _ in shape) or (1 << 31,)
        file.create_dataset(
            name, lengths, dtype, chunks=tuple(min(64, length) for length in lengths), compression="gzip"
        )
    elif kind == 4:  # unfolds
        lengths = (int(one(rng, (10**6, 10**7, 3 * 10**7))), *(max(1, n) for n in shape[1:]))
        dataset = file.create_dataset(name, lengths, dtype, chunks=lengths, compression="gzip")
        n_bytes = min(int(np.prod(lengths, dtype=object)) * dtype.itemsize, 3 * 10**7)
        dataset.id.write_direct_chunk((0,) * len(lengths), packed_zeros(n_bytes))
    elif kind == 5:
        file[name] = np.zeros(tuple(min(n, 64) for n in some_shape), one(rng, DTYPES))
    elif kind == 6:
        file[name] = one(rng, ("words", ["a", "b"], np.inf, h5py.Empty("f4"), -1))
    elif content is not None and (content.dtype == np.uint8 or content.dtype.kind == "S") and content.ndim <= 1:
        file[name] = _changed_text(content, rng)
    elif content is not None and content.dtype.kind in "fiu" and content.size:
        with np.errstate(all="ignore"):
            content.flat[int(rng.integers(content.size))] = np.array(
                one(rng, (np.nan, np.inf, -1, 0, 2**31 - 1, 1e30))
            ).astype(dtype)
        file.create_dataset(name, data=content)
    else:
        file[name] = np.zeros(some_shape[:1])
    for key, value in attributes.items():
        file[name].attrs[key] = value


def _changed_text(content: np.ndarray, rng: Rng) -> np.ndarray:
    """JSON as text, or in the lines of a column, with other parts in it."""
    lines = [content.tobytes()] if content.dtype.kind == "S" else content.tobytes().split(b"\n")
    place = int(rng.integers(len(lines)))
    try:
        value = json.loads(lines[place].rstrip(b"\0"))
        for inner in ("configuration", "rejected"):
            if isinstance(value, dict) and isinstance(value.get(inner), str) and rng.random() < 0.5:
                value[inner] = written(mutated(json.loads(value[inner]), rng))
    except ValueError:
        value = ""
    lines[place] = written(several(rng, lambda known: mutated(known, rng), value)).encode("utf-8", "replace")
    text = b"\n".join(lines)
    return (
        np.frombuffer(text, np.uint8) if content.dtype == np.uint8 else np.resize(np.array(text or b"x"), content.shape)
    )


def npz_of(arrays: dict[str, np.ndarray]) -> Callable[[Path, Rng], None]:
    """A grammar of archives of arrays."""

    def write(path: Path, rng: Rng) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            for name, array in arrays.items():
                if rng.random() < 0.02:
                    continue
                head, body = {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape}, array.tobytes()
                if rng.random() < 0.08:
                    key = one(rng, list(head))
                    shapes = (
                        tuple(int(one(rng, LENGTHS)) for _ in array.shape),
                        (-1,),
                        (2**62, 4),
                        3,
                        "x",
                        [1],
                        ((1, 2),),
                        None,
                    )
                    head[key] = one(
                        rng, shapes if key == "shape" else (*DTYPES, "|O", "V9", [("a", "f4")], None, "<f4" * 99, True)
                    )
                text = (
                    repr(head) if rng.random() < 0.95 else one(rng, ("{", "(" * 5000, "[]", "1", "__import__('os')"))
                ) + "\n"
                if rng.random() < 0.03:
                    body = one(rng, (b"", body[:-1], body * 2, bytes(10**7)))
                content = (
                    b"\x93NUMPY"
                    + bytes(one(rng, ([1, 0],) * 60 + ([2, 0], [9, 9])))
                    + struct.pack("<H", len(text))
                    + text.encode()
                    + body
                )
                compression = one(
                    rng,
                    (
                        zipfile.ZIP_STORED,
                        *[zipfile.ZIP_DEFLATED] * 40,
                        zipfile.ZIP_BZIP2,
                        zipfile.ZIP_LZMA,
                    ),
                )
                archive.writestr(f"{name}.npy", content, compression, 1)

    return write
