"""``datagen verify``: what it prints, and that what it tells to do repairs a folder."""

import json
import shlex
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from datagen.cli import main
from pix2face.shards.shard_writing import write_shard
from tests.pix2face.shard_files import HEADER, make_triplet
from tests.pix2face.shards.test_shard_checks import doubtful_photographs


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three shards of a job of six samples, in a folder whose name needs quotes."""
    folder = tmp_path / "my shards"
    header = replace(HEADER, configuration='{"n_faces": 6, "shard_size": 2}')
    for unit in range(3):
        write_shard(folder / f"shard-{unit:05d}.h5", header, [make_triplet(2 * unit), make_triplet(2 * unit + 1)])
    return folder


def test_a_sound_folder(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(folder)]) == 0
    assert capsys.readouterr().out == "3 shards, 6 samples: no problem found\n"


def test_the_line_that_repairs_names_all_damaged_shards_and_no_other(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for unit in (0, 2):
        path = folder / f"shard-{unit:05d}.h5"
        content = bytearray(path.read_bytes())
        content[len(content) // 2 :] = bytes(len(content) - len(content) // 2)
        path.write_bytes(content)
    assert main(["verify", str(folder)]) == 2
    *_, what_to_do, line = capsys.readouterr().out.splitlines()
    assert "delete the damaged shards and run the same `datagen render` again" in what_to_do
    command = shlex.split(line)
    assert command == ["rm", str(folder / "shard-00000.h5"), str(folder / "shard-00002.h5")]
    subprocess.run(command, check=True)
    assert [path.name for path in folder.iterdir()] == ["shard-00001.h5"]


def test_missing_shards_need_no_deletion(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "shard-00002.h5").unlink()
    assert main(["verify", str(folder)]) == 2
    assert capsys.readouterr().out.splitlines() == [
        "1 missing: shard-00002.h5",
        "1 problem; run the same `datagen render` again: it writes what is missing",
    ]


def test_what_cannot_be_true_needs_no_deletion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_shard(tmp_path / "shard-00000.h5", HEADER, doubtful_photographs())
    assert main(["verify", str(tmp_path)]) == 2
    *lines, what_to_do = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    assert what_to_do.startswith("4 doubts about ground truth; convert or fit their annotations again")
    assert main(["stats", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "ground truth that cannot be true" in printed
    assert "face/2" in printed
    assert main(["stats", str(tmp_path), "--json"]) == 0
    assert [one["sample_id"] for one in json.loads(capsys.readouterr().out)["doubtful"]] == [
        "face/1",
        "face/2",
        "face/3",
    ]
