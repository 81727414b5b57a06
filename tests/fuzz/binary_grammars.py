"""Grammars of binary files: HDF5, archives, pickles, MAT 5, checkpoints, published models, pictures."""

import io
import json
import pickle
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import numpy as np

from datagen.inspection.coefficient_summary import summarise_table
from pix2face.evaluation.subjects.predictions_file import read_predictions
from pix2face.face_files.coefficients import load_coefficients
from pix2face.face_files.w300lp import read_coefficient_file
from pix2face.files.images import read_photograph
from pix2face.inference.checkpoint import CheckpointHeader, load_checkpoint, save_checkpoint
from pix2face.model_formats import read_model
from pix2face.models.model_file import read_stored_model, write_stored_model
from pix2face.networks.paper import UNet, paper_widths
from tests.fuzz.grammar import Grammar
from tests.fuzz.values import JSON_PIECES, LENGTHS, NUMBERS, TEXTS, Rng, mutated, one, several, written
from tests.fuzz_shards import read_shard, write_small_shard, write_table
from tests.model_files import stored_small_head
from tests.published_models import tiny_solid, write_flame, write_gnm, write_statismo, write_surrey

DTYPES = ("<f4", "<f8", "<f2", ">i4", "u1", "<i8", "S4", "<c8", "?")


@cache
def original(write: Callable[[Path], object], name: str) -> bytes:
    """A file without fault, written once."""
    with TemporaryDirectory() as folder:
        write(Path(folder))
        return (Path(folder) / name).read_bytes()


@cache
def packed_zeros(n_bytes: int) -> bytes:
    """Zeros, a thousandth of the size."""
    return zlib.compress(bytes(n_bytes), 1)


def hdf5_of(write_original: Callable[[Path], object], name: str) -> Callable[[Path, Rng], None]:
    """A grammar of HDF5 files around one that is right."""

    def write(path: Path, rng: Rng) -> None:
        path.write_bytes(original(write_original, name))
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


def flame_pickle(path: Path, rng: Rng) -> None:
    """The right fields among what other pickles hold; or operations in a row."""
    content = original(lambda folder: write_flame(folder / "a.pkl", tiny_solid(), chumpy=False), "a.pkl")
    if rng.random() < 0.6:
        pieces = b"".join(_operation(rng) for _ in range(int(one(rng, (1, 5, 40, 300)))))
        key = one(rng, (b"X\x01\0\0\0f", b"X\x09\0\0\0shapedirs", b"N", b"K\x01", b"X\x0a\0\0\0v_template"))
        path.write_bytes(content[:-1] + key + pieces + b"s." if rng.random() < 0.7 else b"\x80\x02" + pieces + b".")
        return
    path.write_bytes(
        content[:-1] + b"X\x01\0\0\0f" + pickle.dumps(_doubled(rng), 2)[2:-1] + b"s."
        if rng.random() < 0.5
        else pickle.dumps({"f": _doubled(rng)}, 2)
    )


def _doubled(rng: Rng) -> Any:
    """Lists of lists that are few in the file and many when they are followed, or deep ones."""
    value: Any = one(rng, ([1.5], "a", {"a": 1}, 10**400, ()))
    n, is_tuple = int(one(rng, (2, 10, 30))), rng.random() < 0.5
    for _ in range(int(one(rng, (5, 30, 300)))):
        value = (value,) * n if is_tuple else [value] * n
    return value


def _operation(rng: Rng) -> bytes:
    operations = (
        b"N",
        b"]",
        b")",
        b"}",
        b"(",
        b"t",
        b"l",
        b"d",
        b"a",
        b"e",
        b"s",
        b"u",
        b"0",
        b"1",
        b"2",
        b"\x85",
        b"\x86",
        b"\x87",
        b"R",
        b"b",
        b"\x81",
        b"\x8f",
        b"\x90",
        b"\x91",
        b"\x94",
        b"q\0",
        b"q\1",
        b"h\0",
        b"h\1",
        b"K\xff",
        b"J\xff\xff\xff\xff",
        b"G" + bytes(8),
        b"\x8b" + struct.pack("<i", int(one(rng, (3, 2**31 - 1, -1)))) + b"abc",
        b"X" + struct.pack("<I", int(one(rng, (1, 2**31)))) + b"a",
        b"\x96" + struct.pack("<Q", int(one(rng, (1, 2**40)))) + b"a",
        b"\x8e" + struct.pack("<Q", int(one(rng, (1, 2**62)))) + b"a",
        b"I" + str(one(rng, NUMBERS)).encode() + b"\n",
        b"L" + b"9" * 4000 + b"L\n",
        b"g99\n",
        b"p-1\n",
        b"r\xff\xff\xff\x7f",
        b"cnumpy\nndarray\n",
        b"cnumpy\ndtype\n",
        b"cnumpy.core.multiarray\n_reconstruct\n",
        b"c_codecs\nencode\n",
        b"cos\nsystem\n",
        b"cchumpy.ch\nCh\n",
        b"ccopy_reg\n_reconstructor\n",
        b"c__builtin__\nset\n",
        b"\x95" + bytes(8),
        b"Va\n",
        b"S'a'\n",
    )
    return one(rng, operations)


def mat(path: Path, rng: Rng) -> None:
    def element(kind: int, body: bytes, declared: int | None = None) -> bytes:
        return struct.pack("<II", kind, len(body) if declared is None else declared) + body + bytes(-len(body) % 8)

    variables = b""
    for name, shape in (("Shape_Para", (199, 1)), ("Exp_Para", (29, 1)), ("Pose_Para", (1, 7)), ("pt3d_68", (3, 68))):
        declared = (
            shape
            if rng.random() < 0.85
            else tuple(int(one(rng, LENGTHS)) % 2**31 for _ in range(int(one(rng, (0, 1, 2, 3, 40)))))
        )
        values = np.ones(shape) if rng.random() < 0.97 else np.full(shape, one(rng, (np.nan, np.inf, 1e300, 0)))
        flags = int(one(rng, (6,) * 150 + (0, 1, 2, 3, 4, 5, 15, 99, 0x0806)))
        kind = int(one(rng, (9,) * 150 + (1, 5, 7, 14, 15, 16, 99)))
        n_bytes = None if rng.random() < 0.98 else int(one(rng, LENGTHS)) % 2**32
        label = name.encode() if rng.random() < 0.95 else one(rng, (b"", b"\xff", b"x" * 600))
        body = element(6, struct.pack("<II", flags, 0)) + element(5, struct.pack(f"<{len(declared)}i", *declared))
        body += element(1, label) + element(kind, values.tobytes(), n_bytes)
        variable = element(14, body, None if rng.random() < 0.98 else int(one(rng, LENGTHS)) % 2**32)
        if rng.random() < 0.4:
            packed = zlib.compress(variable + (bytes(5 * 10**6) if rng.random() < 0.1 else b""), 1)
            variable = struct.pack("<II", 15, len(packed)) + packed
        variables += variable
    path.write_bytes(b"MATLAB 5.0".ljust(124) + one(rng, (b"\0\1IM",) * 30 + (b"\0\2IM", b"\1\0MI")) + variables)


def surrey(path: Path, rng: Rng) -> None:
    content = bytearray(original(lambda folder: write_surrey(folder, tiny_solid()), "model.bin"))
    for _ in range(int(rng.integers(1, 4))):
        place, layout = int(one(rng, range(0, len(content) - 8, 4))), one(rng, ("<I", "<Q", "<f"))
        value = (
            one(rng, (np.nan, np.inf, 1e30))
            if layout == "<f"
            else int(one(rng, LENGTHS)) % (1 << 8 * struct.calcsize(layout))
        )
        struct.pack_into(layout, content, place, value)
    path.write_bytes(content)


def checkpoint(path: Path, rng: Rng) -> None:
    def save(folder: Path) -> None:
        header = CheckpointHeader(
            model_name="a",
            model_sha256="b",
            size_px=16,
            widths=paper_widths(16, 4),
            pncc_scale_mm=1.0,
            offset_scale_mm=1.0,
            smallest_radius_mm=1.0,
            licence="",
            configuration='{"seed": 0}',
            epoch=1,
        )
        save_checkpoint(folder / "a", header, UNet(16, 4))

    content = original(save, "a")
    n_bytes = struct.unpack("<Q", content[:8])[0]
    fields = json.loads(content[8 : 8 + n_bytes])
    if rng.random() < 0.7:
        inner = json.loads(fields["__metadata__"]["pix2face-checkpoint"])
        fields["__metadata__"]["pix2face-checkpoint"] = written(several(rng, lambda known: mutated(known, rng), inner))
    else:
        fields = several(rng, lambda known: mutated(known, rng), fields)
    text = written(fields).encode("utf-8", "replace")
    length = len(text) if rng.random() < 0.95 else int(one(rng, LENGTHS))
    path.write_bytes(struct.pack("<Q", length) + text + content[8 + n_bytes :])


def picture(path: Path, rng: Rng) -> None:
    width, height = (int(one(rng, (0, 1, 7, 300, 32_000, 65_535))) for _ in range(2))
    body = one(rng, (b"", rng.bytes(50), rng.bytes(3000), bytes(10**5)))

    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    def tiff() -> bytes:
        tags = {
            256: width,
            257: height,
            258: one(rng, (1, 8, 16, 32, 64)),
            259: one(rng, (1, 5, 7, 8)),
            262: one(rng, (0, 1, 2, 3)),
            273: 400,
            277: one(rng, (1, 3, 4, 255)),
            278: height,
            279: len(body),
            339: one(rng, (1, 2, 3, 6)),
        }
        if rng.random() < 0.3:
            tags |= {322: one(rng, (16, 65_535)), 323: one(rng, (16, 65_535)), 324: 400, 325: len(body)}
        entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in sorted(tags.items()))
        return (b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4)).ljust(400, b"\0") + body

    def jpeg() -> bytes:
        image = np.full((int(one(rng, (8, 64))), 64, 3), 90, np.uint8)
        from cv2 import IMWRITE_JPEG_PROGRESSIVE, imencode

        content = imencode(".jpg", image, [IMWRITE_JPEG_PROGRESSIVE, int(rng.integers(2))])[1].tobytes()
        frame = max(content.find(b"\xff\xc0"), content.find(b"\xff\xc2"))
        if rng.random() < 0.6:
            content = content[: frame + 5] + struct.pack(">HH", height, width) + content[frame + 9 :]
        last = content[content.rindex(b"\xff\xda") : -2]
        return content[:-2] + last * int(one(rng, (0, 0, 1, 2000))) + b"\xff\xd9"

    depth, colour = one(rng, (1, 8, 8, 16)), one(rng, (0, 2, 2, 6))
    png = b"\x89PNG\r\n\x1a\n" + chunk(
        b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, one(rng, (0, 1)))
    )
    formats: tuple[Callable[[], bytes], ...] = (
        lambda: png + chunk(b"IDAT", zlib.compress(body)) + chunk(b"IEND", b""),
        lambda: (
            b"GIF89a"
            + struct.pack("<HH", width, height)
            + b"\x80\0\0"
            + bytes(6)
            + b","
            + struct.pack("<HHHH", 0, 0, width, height)
            + b"\0\2\2L\1\0;"
        ),
        lambda: (
            b"BM"
            + struct.pack(
                "<IIIIiiHHIIIIII", 54, 0, 54, 40, width, height * int(one(rng, (1, -1))), 1, 24, 0, 0, 0, 0, 0, 0
            )
            + body
        ),
        lambda: (
            one(rng, (b"P1", b"P4", b"P5", b"P6", b"Pf", b"PF", b"P7")) + f"\n{width} {height}\n255\n".encode() + body
        ),
        lambda: (
            b"\0\0\0\x1cftypavif\0\0\0\0avifmif1" + b"\0\0\0\x14ispe\0\0\0\0" + struct.pack(">II", width, height) + body
        ),
        tiff,
        jpeg,
    )
    path.write_bytes(one(rng, formats)())


GNM = {
    name: np.asarray(array)
    for name, array in np.load(
        io.BytesIO(original(lambda folder: write_gnm(folder / "a.npz", tiny_solid()), "a.npz"))
    ).items()
}
PREDICTIONS = {
    "names": np.array(["a", "b"]),
    "landmarks": np.ones((2, 68, 2)),
    "landmarks3d": np.ones((2, 68, 3)),
    "pose_deg": np.ones((2, 3)),
}
BINARY_GRAMMARS = {
    "table": Grammar(hdf5_of(write_table, "faces.h5"), lambda path: summarise_table(load_coefficients(path)), ".h5"),
    "shard": Grammar(hdf5_of(lambda folder: write_small_shard(folder, "deflate"), "shard-00000.h5"), read_shard, ".h5"),
    "model": Grammar(
        hdf5_of(lambda folder: write_stored_model(stored_small_head(), folder / "a.h5"), "a.h5"),
        read_stored_model,
        ".h5",
    ),
    "statismo": Grammar(
        hdf5_of(lambda folder: write_statismo(folder / "a.h5", tiny_solid(), landmarks="[]", unit_m=0.001), "a.h5"),
        read_model,
        ".h5",
    ),
    "gnm": Grammar(npz_of(GNM), read_model, ".npz"),
    "predictions npz": Grammar(npz_of(PREDICTIONS), lambda path: read_predictions(path, "0-based"), ".npz"),
    "flame": Grammar(flame_pickle, read_model, ".pkl"),
    "mat": Grammar(mat, read_coefficient_file, ".mat"),
    "surrey": Grammar(surrey, read_model, ".bin"),
    "checkpoint": Grammar(checkpoint, load_checkpoint, ".safetensors"),
    "picture": Grammar(picture, read_photograph, ".jpg"),
}
