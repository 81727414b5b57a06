"""Pickles of arrays are read, everything else is refused with the name that it asked for, and nothing is run."""

import collections
import io
import os
import pickle
import pickletools
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as numpy_strategies
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.model_formats import restricted_pickle
from pix2face.model_formats.pickled_arrays import as_array
from pix2face.model_formats.restricted_pickle import read_pickle
from tests.published_models import chumpy_modules

MARK = Path("run-by-pickle")


class Hostile:
    """Asks for a function with arguments when it is unpickled."""

    def __init__(self, function: Any, *arguments: Any) -> None:
        self.call = function, arguments

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return self.call


def written(path: Path, value: Any, protocol: int = 2) -> Path:
    path.write_bytes(pickle.dumps(value, protocol=protocol))
    return path


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_come_back(tmp_path: Path, protocol: int, order: Any) -> None:
    arrays = [np.arange(12.0).reshape(3, 4), np.arange(6, dtype=">i2").reshape(2, 3), np.zeros((0, 3)), np.array(True)]
    value = {"a": [np.asarray(array, order=order) for array in arrays], "n": 3, "s": np.float32(2.5)}
    fields = read_pickle(written(tmp_path / "a.pkl", value, protocol))
    for found, array in zip(fields["a"], arrays, strict=True):
        np.testing.assert_array_equal(as_array(found, "a"), array)
    assert as_array(fields["n"], "n") == 3
    assert as_array(fields["s"], "s") == 2.5


@given(
    array=numpy_strategies.arrays(
        st.sampled_from([np.float32, np.float64, np.int8, np.uint32, np.int64]),
        numpy_strategies.array_shapes(min_dims=0, max_dims=4, min_side=0),
    ),
    protocol=st.integers(2, 5),
)
def test_any_array_comes_back(tmp_path_factory: pytest.TempPathFactory, array: ndarray, protocol: int) -> None:
    path = written(tmp_path_factory.mktemp("a") / "a.pkl", {"x": array}, protocol)
    np.testing.assert_array_equal(as_array(read_pickle(path)["x"], "x"), array)


def test_chumpy_is_read_without_chumpy(tmp_path: Path) -> None:
    with chumpy_modules() as containers:
        inner = containers.Ch(np.arange(12.0).reshape(3, 4))
        chosen = containers.Select(inner, np.array([0, 5, 1, 6]), (2, 2))
        written(tmp_path / "a.pkl", {"plain": inner, "chosen": chosen})
    assert "chumpy" not in sys.modules
    fields = read_pickle(tmp_path / "a.pkl")
    np.testing.assert_array_equal(as_array(fields["plain"], "a"), np.arange(12.0).reshape(3, 4))
    np.testing.assert_array_equal(as_array(fields["chosen"], "a"), [[0, 5], [1, 6]])


def test_sparse_columns_do_no_harm(tmp_path: Path) -> None:
    value = {"J_regressor": scipy.sparse.csc_matrix(np.eye(3)), "x": np.ones(2)}
    fields = read_pickle(written(tmp_path / "a.pkl", value))
    assert as_array(fields["x"], "x").sum() == 2
    with pytest.raises(InputFileError, match="csc_matrix"):
        as_array(fields["J_regressor"], "J_regressor")


@pytest.mark.parametrize(
    ("value", "name"),
    [
        (Hostile(os.system, f"touch {MARK}"), r"(posix|nt)\.system"),
        (Hostile(eval, f"open('{MARK}', 'w')"), r"__builtin__\.eval"),
        (Hostile(exec, f"open('{MARK}', 'w')"), r"__builtin__\.exec"),
        (Hostile(subprocess.Popen, ["touch", str(MARK)]), r"(subprocess|commands)\.Popen"),
        (Hostile(getattr, np.ndarray, "tofile"), r"__builtin__\.getattr"),
        (Hostile(np.fromfile, "/etc/passwd"), r"numpy.*fromfile"),
        (Hostile(np.zeros, 10**12), r"numpy.*zeros"),
        (Hostile(bytearray, 10**12), r"__builtin__\.bytearray"),
        (collections.Counter(), r"collections\.Counter"),
    ],
    ids=["system", "eval", "exec", "popen", "getattr", "fromfile", "zeros", "bytearray", "counter"],
)
def test_hostile_pickles_are_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, value: Any, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputFileError, match=rf"asks for {name}; it was not given"):
        read_pickle(written(tmp_path / "a.pkl", {"v_template": value}))
    assert not MARK.exists()


def test_the_hostile_pickle_would_have_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    pickle.loads(pickle.dumps(Hostile(os.system, f"touch {MARK}")))  # what the reader must never do
    assert MARK.exists()


RECONSTRUCT = b"cnumpy.core.multiarray\n_reconstruct\n"


@pytest.mark.parametrize(
    "program",
    [
        # numpy itself would make room for 10^12 numbers at the first of these
        b"\x80\x02}(X\x01\x00\x00\x00a" + RECONSTRUCT + b"cnumpy\nndarray\n(L1000000000000L\ntU\x01d\x87Ru.",
        b"\x80\x02}(X\x01\x00\x00\x00acnumpy\nndarray\n(L1000000000000L\nt\x81u.",
        b"\x80\x02r\xff\xff\xff\x7f.",  # LONG_BINPUT far beyond any memo
        b"\x80\x05\x96\xff\xff\xff\xff\xff\xff\xff\x0f.",  # BYTEARRAY8 of 2^60 bytes
        b"\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\x0f.",  # BINBYTES8 of 2^60 bytes
        b"\x80\x02" + b"(" * 100000 + b".",
        b"\x80\x02]" + b"\x85" * 100000 + b".",
        b"\x80\x02cchumpy.ch\nCh\n)\x81cchumpy.ch\nCh\nb.",
        b"\x80\x02cnumpy\nndarray\n}U\x01aI1\nsb.",  # a state for the class itself
        b"\x80\x02I1\n)R.",
        b"\x80\x02}U\x01aPsecret\ns.",  # persistent id
        b"\x80\x02\x82\x01.",  # extension registry
        b"(dp0\n.garbage",
        b"\x80\x02].",
        b"\x80\x63}.",
        b"\x80",
    ],
)
def test_hostile_programs_end_at_once(tmp_path: Path, program: bytes) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(program)
    with pytest.raises(InputFileError, match=r"expected (a pickle|an array)"):
        as_array(read_pickle(path).get("a"), "a")


def test_sizes_that_contradict_their_data_are_refused(tmp_path: Path) -> None:
    content = pickle.dumps({"x": np.arange(7.0)}, protocol=2)
    place = next(at for opcode, value, at in pickletools.genops(content) if opcode.name == "BININT1" and value == 7)
    (tmp_path / "a.pkl").write_bytes(content[: place + 1] + b"\x09" + content[place + 2 :])
    with pytest.raises(InputFileError, match=r"shape \(9,\) with 56 bytes"):
        as_array(read_pickle(tmp_path / "a.pkl")["x"], "x")


@pytest.mark.parametrize("value", [[1, 2], np.arange(3), "text", None])
def test_what_is_no_dictionary_is_refused(tmp_path: Path, value: Any) -> None:
    with pytest.raises(InputFileError, match="expected a pickled dictionary"):
        read_pickle(written(tmp_path / "a.pkl", value))


def test_objects_and_text_are_no_arrays(tmp_path: Path) -> None:
    fields = read_pickle(written(tmp_path / "a.pkl", {"o": np.array([None, 1]), "t": np.array(["a"]), "s": "words"}))
    for value in fields.values():
        with pytest.raises(InputFileError, match="expected an array of numbers"):
            as_array(value, "a")


def doubled(value: Any, levels: int, n: int = 10) -> Any:
    """A list of n times a list of n times ... a value: few bytes as a pickle, n**levels values when followed."""
    for _ in range(levels):
        value = [value] * n
    return value


def nested(levels: int) -> tuple[Any, ...]:
    value: tuple[Any, ...] = ()
    for _ in range(levels):
        value = (value,)
    return value


def as_tuples(value: Any) -> Any:
    return tuple([as_tuples(value[0])] * len(value)) if isinstance(value, list) else value


@pytest.mark.parametrize("value", [doubled(1.5, 10), as_tuples(doubled(1.5, 10)), doubled([], 30, 2)])
def test_references_are_counted_when_they_are_followed(tmp_path: Path, value: Any) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({"f": value}))
    assert path.stat().st_size < 1000
    fields = read_pickle(path)
    with pytest.raises(InputFileError, match=r"a\.pkl \(f\): expected an array of numbers, found none"):
        as_array(fields["f"], f"{path} (f)")


@pytest.mark.parametrize("key", [as_tuples(doubled(1, 10)), 10**5000, nested(500)], ids=["doubled", "huge", "deep"])
def test_keys_are_text_or_small_numbers(tmp_path: Path, key: Any) -> None:
    writer = io.BytesIO()
    pickle.Pickler(writer, 2).dump(key)
    (tmp_path / "a.pkl").write_bytes(b"\x80\x02}" + writer.getvalue()[2:-1] + b"Ns.")
    with pytest.raises(InputFileError, match=r"a\.pkl: .* a key of type (int|tuple)"):
        read_pickle(tmp_path / "a.pkl")


def test_members_of_sets_are_not_hashed(tmp_path: Path) -> None:
    inner = pickle.dumps(nested(500), 4)[2:-1]
    (tmp_path / "a.pkl").write_bytes(b"\x80\x04}\x8c\x01a\x8f(" + inner + b"\x90s.")
    assert read_pickle(tmp_path / "a.pkl")["a"] == set()


def test_operations_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(restricted_pickle, "MOST_OPERATIONS", 1000)
    (tmp_path / "a.pkl").write_bytes(b"\x80\x02" + b"\x8f0" * 600 + b"}.")
    with pytest.raises(InputFileError, match=r"a\.pkl: .* more than 1000 operations"):
        read_pickle(tmp_path / "a.pkl")
