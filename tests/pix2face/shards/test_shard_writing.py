"""Writing shards: what does not fit or cannot be written is refused, and leaves nothing behind."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.shards.shard_checks import verify_shard
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.pix2face.shard_files import HEADER, make_triplet


def test_an_error_leaves_neither_shard_nor_temporary_file(tmp_path: Path) -> None:
    bad = make_triplet(0)
    bad.maps.pncc[10, 10] = 300
    with pytest.raises(InputFileError, match=r"pncc within ±255\.9 mm"):
        write_shard(tmp_path / "shard-00000.h5", HEADER, [bad])
    assert list(tmp_path.iterdir()) == []


def test_a_duplicate_id_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="sample ids are not unique"):
        write_shard(tmp_path / "shard-00000.h5", HEADER, [make_triplet(0), make_triplet(0)])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"layers": {"pncc": np.zeros((24, 24, 3), np.float32)}}, "face/0: expected the layer offset, found pncc"),
        ({"image_bytes": None}, "face/0: expected a picture, since the shard is to have them; found none"),
        ({"identity": np.array([np.nan])}, "face/0: expected finite identity, found others"),
        ({"landmarks2d": np.full((68, 2), 1e300)}, "face/0: expected finite landmarks2d"),
        ({"sample_id": "a\0b"}, "bytes of UTF-8 as sample_id, found a NUL character"),
        ({"sample_id": "a\udc80"}, "as sample_id, found characters that UTF-8 has not"),
        ({"sample_id": "x" * 5000}, "expected at most 4096 bytes of UTF-8 as sample_id, found 5000 bytes"),
        ({"attributes": {"text": "x" * 20000}}, "expected at most 16384 bytes of UTF-8 as attributes"),
    ],
)
def test_samples_that_do_not_fit_are_refused(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputFileError, match=message):
        write_shard(tmp_path / "shard-00000.h5", HEADER, [replace(make_triplet(0), **changes)])
    assert list(tmp_path.iterdir()) == []


def test_layers_of_another_size_are_refused(tmp_path: Path) -> None:
    triplet = make_triplet(0)
    layers = {**triplet.layers, "depth": triplet.layers["depth"][:20]}
    with pytest.raises(InputFileError, match=r"face/0: expected depth of shape \(24, 24\), found \(20, 24\)"):
        write_shard(tmp_path / "shard-00000.h5", HEADER, [replace(triplet, layers=layers)])


def test_samples_of_two_models_are_refused(tmp_path: Path) -> None:
    other = replace(make_triplet(1), identity=np.zeros(9))
    with pytest.raises(InputFileError, match=r"samples of one model in a shard, found identity of shapes"):
        write_shard(tmp_path / "shard-00000.h5", HEADER, [make_triplet(0), other])


def test_a_full_disk_is_one_clear_error_and_leaves_nothing(tmp_path: Path) -> None:
    """A limit on the size of files stands in for the disk: the error comes from the same call."""
    code = f"""
import resource, signal
from pathlib import Path
from pix2face.errors import UsageError
from pix2face.shards.shard_writing import write_shard
from tests.pix2face.shard_files import HEADER, make_triplet
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
try:
    write_shard(Path({str(tmp_path)!r}) / "shard-00000.h5", HEADER, [make_triplet(seed) for seed in range(9)])
except UsageError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "make room or choose another folder, and run the same command again" in done.stdout
    assert list(tmp_path.iterdir()) == []


def test_what_does_not_read_back_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read_bytes = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read_bytes(path)[:-1] + b"?")
    with pytest.raises(InputFileError, match=r"written, but does not read back the same; is the disk sound\?"):
        write_shard(tmp_path / "shard-00000.h5", HEADER, [make_triplet(0)])
    assert list(tmp_path.iterdir()) == []


def test_the_default_needs_no_plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hdf5plugin", None)
    for n in (0, 2):
        write_shard(tmp_path / "shard-00000.h5", HEADER, [make_triplet(seed) for seed in range(n)])
        assert verify_shard(tmp_path / "shard-00000.h5") == []


def test_more_rejected_samples_than_an_attribute_could_hold(tmp_path: Path) -> None:
    rejected = str([["x" * 90, "y" * 90]] * 2000).replace("'", '"')
    write_shard(tmp_path / "shard-00000.h5", replace(HEADER, rejected=rejected), [make_triplet(0)])
    reader = ShardReader(tmp_path / "shard-00000.h5")
    assert reader.header.rejected == rejected
