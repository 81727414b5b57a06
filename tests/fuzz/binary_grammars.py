"""The grammars of binary files; pickles, MAT 5, checkpoints and published models are drawn here."""

import io
import json
import pickle
import struct
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from datagen.inspection.coefficient_summary import summarise_table
from pix2face.evaluation.subjects.predictions_file import read_predictions
from pix2face.face_files.coefficients import load_coefficients
from pix2face.face_files.w300lp import read_coefficient_file
from pix2face.files.images import read_photograph
from pix2face.inference.centre_files import DetectorHeader, load_detector
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.onnx_files import open_network
from pix2face.inference.torch_networks import save_checkpoint
from pix2face.model_formats import read_model
from pix2face.models.model_file import read_stored_model, write_stored_model
from pix2face.networks.dimensions import paper_widths, residual_widths
from pix2face.networks.paper import UNet
from pix2face.networks.residual import ResidualUNet
from tests.fuzz.array_grammars import hdf5_of, npz_of, originals
from tests.fuzz.grammar import Grammar
from tests.fuzz.picture_grammars import picture
from tests.fuzz.shard_originals import read_shard, write_small_shard, write_table
from tests.fuzz.values import LENGTHS, NUMBERS, Rng, mutated, one, several, written
from tests.model_files import stored_small_head
from tests.published_models import tiny_solid, write_flame, write_gnm, write_statismo, write_surrey
from training.detection.centre_network import CentreNetwork
from training.detection.detector_files import save_detector


def flame_pickle(path: Path, rng: Rng) -> None:
    """The right fields among what other pickles hold; or operations in a row."""
    content = originals(lambda folder: write_flame(folder / "a.pkl", tiny_solid(), chumpy=False))["a.pkl"]
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
    # fmt: off
    operations = (
        b"N", b"]", b")", b"}", b"(", b"t", b"l", b"d", b"a", b"e", b"s", b"u", b"0", b"1", b"2", b"\x85", b"\x86",
        b"\x87", b"R", b"b", b"\x81", b"\x8f", b"\x90", b"\x91", b"\x94", b"q\0", b"q\1", b"h\0", b"h\1", b"K\xff",
        b"J\xff\xff\xff\xff", b"G" + bytes(8),
        b"\x8b" + struct.pack("<i", int(one(rng, (3, 2**31 - 1, -1)))) + b"abc",
        b"X" + struct.pack("<I", int(one(rng, (1, 2**31)))) + b"a",
        b"\x96" + struct.pack("<Q", int(one(rng, (1, 2**40)))) + b"a",
        b"\x8e" + struct.pack("<Q", int(one(rng, (1, 2**62)))) + b"a", b"I" + str(one(rng, NUMBERS)).encode() + b"\n",
        b"L" + b"9" * 4000 + b"L\n", b"g99\n", b"p-1\n", b"r\xff\xff\xff\x7f", b"cnumpy\nndarray\n",
        b"cnumpy\ndtype\n", b"cnumpy.core.multiarray\n_reconstruct\n", b"c_codecs\nencode\n", b"cos\nsystem\n",
        b"cchumpy.ch\nCh\n", b"ccopy_reg\n_reconstructor\n", b"c__builtin__\nset\n", b"\x95" + bytes(8), b"Va\n",
        b"S'a'\n",
    )
    # fmt: on
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
    content = bytearray(originals(lambda folder: write_surrey(folder, tiny_solid()))["model.bin"])
    for _ in range(int(rng.integers(1, 4))):
        place, layout = int(one(rng, range(0, len(content) - 8, 4))), one(rng, ("<I", "<Q", "<f"))
        value = (
            one(rng, (np.nan, np.inf, 1e30))
            if layout == "<f"
            else int(one(rng, LENGTHS)) % (1 << 8 * struct.calcsize(layout))
        )
        struct.pack_into(layout, content, place, value)
    path.write_bytes(content)


def save_paper_network(folder: Path) -> None:
    save_checkpoint(folder / "a", header_of(16, paper_widths(16, 4)), UNet(16, 4))


def save_residual_network(folder: Path) -> None:
    widths = residual_widths(1)
    header = replace(header_of(64, widths), architecture="residual", planes=9, n_landmarks=2, n_corrected=3)
    save_checkpoint(folder / "a", header, ResidualUNet(widths, 9, 2, 3))


def save_small_detector(folder: Path) -> None:
    header = DetectorHeader(widths=(1, 1, 1, 1, 1), neck=1, licence="", configuration='{"seed": 0}', samples=1)
    save_detector(folder / "a", header, CentreNetwork(header.widths, header.neck), torch.float32)


def header_of(size_px: int, widths: tuple[int, ...]) -> CheckpointHeader:
    return CheckpointHeader(
        model_name="a",
        model_sha256="b",
        size_px=size_px,
        widths=widths,
        pncc_scale_mm=1.0,
        offset_scale_mm=1.0,
        smallest_radius_mm=1.0,
        licence="",
        configuration='{"seed": 0}',
        epoch=1,
    )


def safetensors_of(save: Callable[[Path], None]) -> Callable[[Path, Rng], None]:
    """What writes the file of a network with changes in its heads; all but the numbers of its weights."""

    def write(path: Path, rng: Rng) -> None:
        content = originals(save)["a"]
        n_bytes = struct.unpack("<Q", content[:8])[0]
        fields = json.loads(content[8 : 8 + n_bytes])
        kind = rng.random()
        if kind < 0.1:  # a file that is right
            pass
        elif kind < 0.7:
            (key,) = fields["__metadata__"]
            inner = json.loads(fields["__metadata__"][key])
            fields["__metadata__"][key] = written(several(rng, lambda known: mutated(known, rng), inner))
        else:
            fields = several(rng, lambda known: mutated(known, rng), fields)
        text = written(fields).encode("utf-8", "replace")
        length = len(text) if rng.random() < 0.95 else int(one(rng, LENGTHS))
        path.write_bytes(struct.pack("<Q", length) + text + content[8 + n_bytes :])

    return write


GNM = {
    name: np.asarray(array)
    for name, array in np.load(
        io.BytesIO(originals(lambda folder: write_gnm(folder / "a.npz", tiny_solid()))["a.npz"])
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
    "shard": Grammar(hdf5_of(lambda folder: write_small_shard(folder, "coded"), "shard-00000.h5"), read_shard, ".h5"),
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
    "checkpoint": Grammar(safetensors_of(save_paper_network), open_network, ".safetensors"),
    "residual checkpoint": Grammar(safetensors_of(save_residual_network), open_network, ".safetensors"),
    "detector": Grammar(safetensors_of(save_small_detector), load_detector, ".safetensors"),
    "picture": Grammar(picture, read_photograph, ".jpg"),
}
