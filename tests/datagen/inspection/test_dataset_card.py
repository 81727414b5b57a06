"""Cards: they say what is in the shards and what may not be passed on, their examples run, their bytes repeat."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datagen.appearance.appearance_config import DEFAULT, PLAIN
from datagen.cli import main
from datagen.inspection.croissant import CROISSANT_FILE, write_descriptions
from datagen.inspection.dataset_card import CARD_FILE
from datagen.opengl.gl_context import GLContext
from datagen.sampling.faces import sample_faces
from pix2face.command_line import printable
from pix2face.errors import UsageError
from pix2face.face_files.coefficients import save_coefficients
from pix2face.files.images import encode_photograph
from pix2face.models.morphable_model import builtin_model, load_model
from pix2face.shards.sample import Sample
from pix2face.shards.shard_reader import ShardHeader, ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.model_files import write_small_head
from tests.pix2face.shard_files import as_earlier_versions_stored

HOSTILE = "a`b``c\n# heading <script>alert(1)</script>\x1b[2J ![x](http://x)"
Writer = Callable[..., str]


@pytest.fixture
def card(tmp_path: Path, base: tuple[ShardHeader, Sample]) -> Writer:
    """Writes two shards of two samples, their card, and reads it."""

    def write(attributes: dict[str, str | float], compression: str = "deflate", **header: object) -> str:
        for shard in range(2):
            triplets = [replace(base[1], sample_id=f"{shard}{i}", attributes=attributes) for i in range(2)]
            changed = replace(base[0], **header)  # type: ignore[arg-type]
            path = tmp_path / "shards" / f"shard-{shard:05d}.h5"
            write_shard(path, changed, triplets)
            if compression != "deflate":
                as_earlier_versions_stored(path, compression)
        return write_descriptions(tmp_path / "shards")[0].read_text(encoding="utf-8")

    return write


def section(text: str, heading: str) -> str:
    return text.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]


def examples(text: str) -> list[str]:
    return re.findall(r"```python\n(.*?)\n```", text, re.DOTALL)


def test_a_card_says_what_is_in_the_shards(card: Writer, base: tuple[ShardHeader, Sample], tmp_path: Path) -> None:
    text = card({"picture": "plain"}, configuration='{"seed": 3}', region_names=("skin", "lips"))
    n_bytes = sum(path.stat().st_size for path in (tmp_path / "shards").glob("shard-*.h5"))
    assert f"4 samples in 2 shards, {n_bytes / 1e6:.1f} MB, made by `test`." in text
    assert f"`{base[0].model_name}`, SHA-256 `{base[0].model_sha256}`. Regions: `skin`, `lips`." in text
    for name in (*base[0].layers, "`200 x 200 px` 4", "picture: `plain` 4", "as the source states them: `CC0`"):
        assert name in text
    assert '```json\n{\n  "seed": 3\n}\n```' in text
    assert "could not be used" not in text
    rejected = json.dumps([["x", "why"], ["y", "why"]])
    assert "4 could not be used" not in text
    assert "4 samples could not be used: see rejected.jsonl." in card({}, rejected=rejected)


@pytest.fixture
def rendered(gl_session: GLContext, tmp_path: Path) -> Callable[..., str]:
    """Runs `datagen render` and gives what its card says of terms."""
    del gl_session  # skips where there is none

    def render(coeffs: Path, *options: str) -> str:
        out = tmp_path / "out"
        assert main(["render", "--coeffs", str(coeffs), "--out", str(out), "--workers", "1", *options]) == 0
        return section((out / CARD_FILE).read_text(encoding="utf-8"), "What may be passed on")

    return render


def sampled(folder: Path, n_photographs: int = 0, n: int = 3) -> Path:
    """Writes a table of drawn faces; the first of them get a photograph."""
    table = sample_faces(builtin_model(), n, 3, 48)
    (folder / "photograph.jpg").write_bytes(encode_photograph(np.full((48, 48, 3), 90, np.uint8)))
    paths = ["photograph.jpg" if index < n_photographs else "" for index in range(n)]
    save_coefficients(replace(table, image_paths=tuple(paths)), folder / "faces.h5")
    return folder / "faces.h5"


@pytest.mark.gl
@pytest.mark.parametrize("appearance", [PLAIN, DEFAULT])
def test_renders_of_the_builtin_model_are_free(appearance: str, rendered: Callable[..., str], tmp_path: Path) -> None:
    text = rendered(sampled(tmp_path), "--appearance", appearance)
    assert "not to be passed on" not in text
    assert "Rendered pictures (3): CC0-1.0" in text
    assert "the built-in model is under CC0-1.0." in text


@pytest.mark.gl
def test_a_mixture_says_how_many_pictures_are_free(rendered: Callable[..., str], tmp_path: Path) -> None:
    text = rendered(sampled(tmp_path, n_photographs=1))
    assert "**Photographs (1): not to be passed on**" in text
    assert "Rendered pictures (2): CC0-1.0" in text
    assert "bound by their terms as well" in text


@pytest.mark.gl
def test_maps_of_photographs_are_bound_without_the_photographs(rendered: Callable[..., str], tmp_path: Path) -> None:
    text = rendered(sampled(tmp_path, n_photographs=3), "--layers", "pncc,mask")
    assert "Photographs (" not in text
    assert "Rendered pictures" not in text
    assert "bound by their terms as well" in text


@pytest.mark.gl
def test_photographs_of_research_data_are_not_free(
    rendered: Callable[..., str], shared_dir: Path, tmp_path: Path
) -> None:
    (tmp_path / "files").mkdir()
    for path in sorted((shared_dir / "data" / "aflw2000_3d" / "dev").glob("image000*"))[:4]:
        shutil.copy(path, tmp_path / "files")
    text = rendered(tmp_path / "files")
    assert "**Photographs (2): not to be passed on**" in text
    assert "Rendered pictures" not in text
    assert "bound by their terms as well" in text


@pytest.mark.gl
def test_own_pictures_behind_faces_are_not_free(rendered: Callable[..., str], tmp_path: Path) -> None:
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    (pictures / "wall.jpg").write_bytes(encode_photograph(np.full((60, 80, 3), (200, 30, 200), np.uint8)))
    text = rendered(sampled(tmp_path, n=6), "--backgrounds", str(pictures))
    reader = ShardReader(tmp_path / "out" / "shard-00000.h5")
    n_own = sum(attributes["backdrop.kind"] == "photograph" for attributes in reader.attributes())
    assert 0 < n_own < 6
    assert f"picture of your own behind the face ({n_own}): not to be passed on**" in text
    assert f"Rendered pictures ({6 - n_own}): CC0-1.0" in text


@pytest.mark.gl
def test_renders_of_other_models_are_bound_like_the_model(rendered: Callable[..., str], tmp_path: Path) -> None:
    model = load_model(write_small_head(tmp_path / "model.h5"))
    save_coefficients(sample_faces(model, 2, 0, 48), tmp_path / "faces.h5")
    text = rendered(tmp_path / "faces.h5", "--model", str(tmp_path / "model.h5"))
    assert f"renders of `{model.name}`: not to be passed on**" in text
    assert "CC0" not in text
    assert "Photographs (" not in text


def test_pictures_of_unknown_origin_count_as_photographs(card: Writer) -> None:
    unknown = section(card({}, model_sha256=builtin_model().sha256), "What may be passed on")
    assert "**Photographs (4): not to be passed on**" in unknown
    maps = section(card({}, model_sha256=builtin_model().sha256, layers=("pncc", "mask")), "What may be passed on")
    assert "Photographs" not in maps


@pytest.mark.parametrize(
    ("layers", "compression"),
    [
        *((("pncc", "mask"), compression) for compression in ("deflate", "plain", "zstd")),
        (("mask",), "zstd"),
        (("image", "depth", "landmarks"), "deflate"),
    ],
)
def test_the_examples_run_and_read_what_is_there(
    layers: tuple[str, ...], compression: str, card: Writer, tmp_path: Path
) -> None:
    package, plain = examples(card({}, compression, layers=layers))
    is_planar = layers != ("mask",) and compression != "plain"
    assert (len(package.splitlines()), len(plain.splitlines())) == (3, 5 if is_planar else 4)
    assert ("hdf5plugin" in plain) == (compression == "zstd")
    check = "import json, sys; json.dump([str(values.dtype), values.tolist()], sys.stdout)"
    run = [sys.executable, "-W", "error", "-c"]
    found = subprocess.run([*run, f"{plain}\n{check}"], cwd=tmp_path / "shards", capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    dtype, values = json.loads(found.stdout)
    reader = ShardReader(tmp_path / "shards" / "shard-00000.h5")
    name = next(name for name in layers if name not in ("image", "landmarks"))
    np.testing.assert_allclose(values, reader.read(0, [name]).layers[name], atol=1e-6)
    assert dtype.startswith("float")
    namespace: dict[str, object] = {}
    exec(package.replace('"shard', f'"{tmp_path}/shards/shard'), namespace)
    assert isinstance(namespace["sample"], Sample)


def test_sets_without_layers_have_no_example_of_one(card: Writer) -> None:
    assert len(examples(card({}, layers=("image", "landmarks")))) == 1


def test_the_same_shards_have_the_same_card_wherever_they_lie(card: Writer, tmp_path: Path) -> None:
    text = card({"picture": "plain", "geometry": "x"})
    (tmp_path / "shards").rename(tmp_path / "elsewhere")
    assert write_descriptions(tmp_path / "elsewhere")[0].read_text(encoding="utf-8") == text
    assert str(tmp_path) not in text
    assert sorted(path.name for path in (tmp_path / "elsewhere").iterdir()) == [
        CROISSANT_FILE,
        CARD_FILE,
        "shard-00000.h5",
        "shard-00001.h5",
    ]


def test_texts_out_of_files_stay_texts(card: Writer) -> None:
    text = card(
        {"picture": HOSTILE, "geometry": HOSTILE},
        configuration=json.dumps({"seed": HOSTILE + "\n```\n# out of the block"}),
        **dict.fromkeys(("model_name", "licence", "generator"), HOSTILE),
        region_names=(HOSTILE,),
    )
    assert "\x1b" not in text
    shown = "``` a`b``c\\n# heading <script>alert(1)</script>\\x1b[2J ![x](http://x) ```"
    assert text.count(shown) >= 6
    outside = text.replace(shown, "")
    block = section(outside, "Configuration")
    assert block.strip().startswith("````json\n")
    assert block.strip().endswith("\n````")
    assert "<script>" not in outside.split("## Configuration")[0]


def test_a_set_of_which_nothing_could_be_used_has_a_card(base: tuple[ShardHeader, Sample], tmp_path: Path) -> None:
    write_shard(tmp_path / "none" / "shard-00000.h5", replace(base[0], rejected='[["x", "why"]]'), [])
    text = write_descriptions(tmp_path / "none")[0].read_text(encoding="utf-8")
    assert "0 samples in 1 shard" in text
    assert "1 sample could not be used" in text
    assert "Sizes: none" in text


def test_shards_of_two_jobs_have_no_card(card: Writer, base: tuple[ShardHeader, Sample], tmp_path: Path) -> None:
    card({})
    write_shard(tmp_path / "shards" / "shard-00002.h5", replace(base[0], configuration='{"seed": 9}'), [base[1]])
    with pytest.raises(UsageError, match=r"shard-00000\.h5 and shard-00002\.h5 differ in model, layers or config"):
        write_descriptions(tmp_path / "shards")


def test_the_command_writes_the_card(card: Writer, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = card({})
    (tmp_path / "shards" / CARD_FILE).unlink()
    assert main(["card", str(tmp_path / "shards")]) == 0
    assert (tmp_path / "shards" / CARD_FILE).read_text(encoding="utf-8") == text
    assert f"card -> {tmp_path}/shards/{CARD_FILE}" in capsys.readouterr().err
    assert main(["card", str(tmp_path / "nowhere")]) == 2


def described(card: Writer, folder: Path, attributes: dict[str, str], **header: object) -> dict[str, str]:
    card(attributes, **header)
    fields: dict[str, str] = json.loads((folder / "shards" / CROISSANT_FILE).read_text(encoding="utf-8"))
    return fields


def test_a_description_says_who_is_shown_and_what_is_synthetic(card: Writer, tmp_path: Path) -> None:
    rendered = described(card, tmp_path, {"picture": "synthetic"})
    assert rendered["rai:personalSensitiveInformation"] == "None: no picture shows a person who exists."
    assert rendered["rai:dataCollection"].startswith("4 pictures synthetic")
    assert rendered["license"] == "CC0"
    photographs = described(card, tmp_path, {"picture": "photograph"})
    assert photographs["rai:personalSensitiveInformation"] == "4 photographs with faces of people."
    own = described(card, tmp_path, {"picture": "synthetic", "backdrop.file": "mine.jpg"})
    assert own["rai:personalSensitiveInformation"].startswith("4 rendered pictures with a picture of the user's own")
    maps = described(card, tmp_path, {"picture": "photograph"}, layers=("mask", "landmarks"))
    assert maps["rai:dataCollection"] == "There are no pictures, only maps."
    assert maps["rai:personalSensitiveInformation"].startswith("None")


@pytest.mark.filterwarnings("ignore")  # of its own libraries
def test_the_reader_of_mlcommons_accepts_a_description(card: Writer, tmp_path: Path) -> None:
    mlcroissant = pytest.importorskip("mlcroissant", reason="pip install mlcroissant, which brings pandas and rdflib")
    described(card, tmp_path, {"picture": HOSTILE}, model_name=HOSTILE, licence=HOSTILE, generator=HOSTILE)
    metadata = mlcroissant.Dataset(tmp_path / "shards" / CROISSANT_FILE).metadata
    assert metadata.ctx.issues.errors == set()
    assert metadata.license == [printable(HOSTILE)]
    assert metadata.distribution[0].includes == ["shard-*.h5"]
