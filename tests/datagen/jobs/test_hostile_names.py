"""Names from other people's data: they stay inside --out, and messages show them as they stand."""

import json
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datagen.cli import main
from datagen.sampling.faces import sample_faces
from pix2face.face_files.coefficients import save_coefficients
from pix2face.models.model_file import write_stored_model
from pix2face.models.morphable_model import load_model
from pix2face.shards.shard_checks import verify_shard
from pix2face.shards.shard_reader import ShardReader, shard_paths
from tests.model_files import stored_small_head, write_small_head
from tests.pix2face.benchmark_files import frontal_camera, write_mat, write_photograph
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.gl

# What a data set may bring as names of files; separators of Windows, markup and codes of terminals among them.
FILE_NAMES = (
    "...",
    "..\\..\\up",
    "C:\\up",
    "-rf",
    "~",
    "$HOME",
    "[red]face[bold]",
    "a:smile:b",
    "line\nfeed",
    "escape\x1b[2J",
    "gpj.\u202eface",
)
NO_TEXT = os.fsdecode(b"caf\xe9")
SHOWN = {9: "\\t", 10: "\\n", 27: "\\x1b", 0x202E: "\\u202e", 0xDCE9: "\\udce9"}

# What a table may bring as ids, which are no names of files at all.
IDS = ("../../up", "/absolute", "..", "a/../../b", "", "[/red]", "\x1b[2J", "line\nfeed", "CON", "x" * 4000)


def all_files(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def sandbox(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Everything happens three folders deep, with ``~`` and the working directory inside."""
    deep = tmp_path / "a" / "b" / "c"
    deep.mkdir(parents=True)
    monkeypatch.setenv("HOME", str(deep))
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))  # for the workers
    monkeypatch.chdir(deep)
    write_small_head(deep / "model.h5")
    return deep


def render(sandbox: Path, coefficients: Path, out: Path) -> int:
    """Renders, and makes sure that no file beside ``out`` comes, goes or changes."""
    before = all_files(sandbox.parents[2])
    arguments = ["--coeffs", str(coefficients), "--out", str(out), "--model", str(sandbox / "model.h5")]
    status = main(["render", *arguments, "--workers", "1"])
    after = all_files(sandbox.parents[2])
    made = {path for path in after if path not in before}
    assert {path: content for path, content in after.items() if path not in made} == before
    assert made == {out / "shard-00000.h5", out / "rejected.jsonl", out / "dataset_card.md", out / "croissant.json"}
    return status


def write_pair(folder: Path, name: str) -> None:
    """A face of the small head with its photograph."""
    model, camera = small_head_model(), frontal_camera(0.5)
    points = model.mean[model.landmarks["ibug68"]].astype(np.float64)
    pixels = camera.project(points)
    nearer = 0.5 * points[:, 2]
    write_photograph(folder / "t.jpg")
    write_mat(folder / "t.mat", pixels, 0.0, pt3d_68=np.vstack([pixels.T + 0.5, nearer]))
    (folder / "t.jpg").rename(folder / f"{name}.jpg")
    (folder / "t.mat").rename(folder / f"{name}.mat")


def test_names_of_files_stay_inside_and_lose_no_sample(sandbox: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder, out = sandbox / "[blue]data", sandbox / "[green]out"
    for name in (*FILE_NAMES, NO_TEXT):
        write_pair(folder, name)
    broken = "broken [red]\x1b[31m\n:smile:"
    (folder / f"{broken}.mat").write_bytes(b"no MAT file")
    assert render(sandbox, folder, out) == 3
    assert verify_shard(out / "shard-00000.h5") == []
    reader = ShardReader(out / "shard-00000.h5")
    assert sorted(reader.sample_ids) == sorted(FILE_NAMES)
    rejected = [json.loads(line) for line in (out / "rejected.jsonl").read_text().splitlines()]
    assert [entry["sample_id"] for entry in rejected] == [broken, NO_TEXT]
    assert "UTF-8" in rejected[1]["reason"]
    lines = capfd.readouterr().err.splitlines()
    assert any(line.startswith(f"{len(FILE_NAMES) + 2} faces in {folder}; model: small") for line in lines)
    assert f"2 samples rejected, listed in {out}/rejected.jsonl; the first:" in lines
    assert any(line.startswith(f"  {broken.translate(SHOWN)}.mat: expected a MAT 5 file") for line in lines)
    assert not any("\x1b" in line for line in lines)


def test_ids_of_a_table_stay_inside(sandbox: Path, capfd: pytest.CaptureFixture[str]) -> None:
    model, out = load_model(sandbox / "model.h5"), sandbox / "out"
    table = replace(sample_faces(model, len(IDS), 0, 48), sample_ids=IDS)
    save_coefficients(table, sandbox / "faces.h5")
    assert render(sandbox, sandbox / "faces.h5", out) == 0
    reader = ShardReader(shard_paths(out)[0])
    assert tuple(reader.sample_ids) == IDS
    assert main(["verify", str(out)]) == 0
    before = all_files(sandbox.parents[2])
    assert main(["preview", str(out)]) == 0
    assert set(all_files(sandbox.parents[2])) - set(before) == {out / "preview.jpg"}
    (out / "shard-00001.h5").write_bytes((out / "shard-00000.h5").read_bytes())
    capfd.readouterr()
    assert main(["verify", str(out)]) == 2
    printed = capfd.readouterr().out
    assert "shard-00001.h5: id '\\x1b[2J' occurs twice" in printed
    assert "id '[/red]' occurs twice" in printed
    assert "\x1b" not in printed


def test_photographs_of_a_table_that_lie_elsewhere_are_only_read(sandbox: Path) -> None:
    """A table may point anywhere: what it points to is embedded where it is a picture, else rejected."""
    model, out = load_model(sandbox / "model.h5"), sandbox / "out"
    write_photograph(sandbox.parent / "outside.jpg")
    paths = ("../outside.jpg", "../nothing.jpg", str(sandbox / "model.h5"), "..", "/dev/zero")
    table = replace(sample_faces(model, len(paths), 0, 200), image_paths=paths)
    save_coefficients(table, sandbox / "faces.h5")
    assert render(sandbox, sandbox / "faces.h5", out) == 3
    rejected = [json.loads(line) for line in (out / "rejected.jsonl").read_text().splitlines()]
    assert [entry["sample_id"] for entry in rejected] == list(table.sample_ids[1:])


def test_a_model_is_described_as_it_stands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = replace(stored_small_head(), name="[red]\x1b[2Jname", licence="[/] :smile:", origin="a[link=x]b")
    write_stored_model(model, tmp_path / "model.h5")
    assert main(["model", "info", str(tmp_path / "model.h5")]) == 0
    printed = capsys.readouterr().out
    for text in ("[red]\\x1b[2Jname", "[/] :smile:", "a[link=x]b"):
        assert text in printed


@pytest.mark.parametrize("name", ["[red]nothing", "[/]", "line\nfeed\x1b[2J"])
def test_a_wrong_path_is_one_line_as_it_stands(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "--coeffs", str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"datagen: error: {tmp_path}/{name.translate(SHOWN)}: expected")
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
