"""Statistics: what was put into shards is counted, what is rare is named, whatever the names are."""

import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from datagen.cli import main
from datagen.inspection.dataset_statistics import QUANTITIES, CoefficientStatistics, DatasetStatistics, Histogram
from datagen.inspection.sample_counts import LARGEST_KINDS, count_samples
from datagen.inspection.statistics_tables import (
    N_KINDS_SHOWN,
    listings,
    picture_png,
    print_summary,
    statistics_page,
    statistics_picture,
)
from pix2face.errors import UsageError
from pix2face.geometry.camera import Camera, HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.shards.sample import Sample
from pix2face.shards.shard_reader import ShardHeader
from pix2face.shards.shard_writing import write_shard

HOSTILE = "</td><script>alert(1)</script>[red]\x1b[2J"
Writer = Callable[[list[Sample]], Path]


@pytest.fixture
def write(tmp_path: Path, base: tuple[ShardHeader, Sample]) -> Writer:
    """Writes samples as shards of 100."""

    def write(triplets: list[Sample]) -> Path:
        for shard, start in enumerate(range(0, max(len(triplets), 1), 100)):
            write_shard(tmp_path / "shards" / f"shard-{shard:05d}.h5", base[0], triplets[start : start + 100])
        return tmp_path / "shards"

    return write


def turned(yaw_deg: float, pitch_deg: float = 0.0, roll_deg: float = 0.0, scale: float = 0.5) -> Camera:
    rotation = rotation_of_pose(HeadPose(pitch_deg, yaw_deg, roll_deg))
    return weak_perspective_camera(WeakPerspective(scale, rotation, np.full(2, 100.0)))


def histogram(found: DatasetStatistics, name: str) -> dict[str, int]:
    one = next(histogram for histogram in found.histograms if histogram.name == name)
    return {one.range_name(i, i): int(n) for i, n in enumerate(one.counts) if n}


def test_what_was_put_in_is_counted(write: Writer, base: tuple[ShardHeader, Sample]) -> None:
    rng = np.random.default_rng(0)
    triplets = []
    for i in range(150):
        triplet = replace(
            base[1],
            sample_id=str(i),
            camera=turned(80.0 if i == 0 else -20.0, pitch_deg=10.0, roll_deg=-50.0 if i < 30 else 5.0),
            identity=2 * rng.standard_normal(len(base[1].identity)),
            expression=np.where(np.arange(len(base[1].expression)) == 1, -4.0, 0.5),
            landmarks2d=np.linspace([10, 20], [110, 60 if i % 2 else 220], 68),
            visible=np.arange(68) >= 17,
            attributes={"geometry": "fitted" if i else HOSTILE, "residual_px": float(i), "id": f"name {i}"},
        )
        triplets.append(triplet)
    found = count_samples(write(triplets))
    assert (found.n_samples, found.n_shards, found.picture_sizes) == (150, 2, {"200 x 200": 150})
    assert histogram(found, "yaw") == {"75 to 90 °": 1, "-30 to -15 °": 149}
    assert histogram(found, "pitch") == {"0 to 15 °": 150}
    assert histogram(found, "roll") == {"-60 to -45 °": 30, "0 to 15 °": 120}
    assert histogram(found, "face size") == {"96 to 128 px": 75, "192 to 256 px": 75}
    identity, expression = found.coefficients
    expected = np.sqrt(np.mean([triplet.identity.astype(np.float32) ** 2 for triplet in triplets], axis=0))
    np.testing.assert_allclose(identity.rms, expected, rtol=1e-5)
    np.testing.assert_allclose(identity.far_share, np.mean([abs(t.identity) > 3 for t in triplets], axis=0))
    np.testing.assert_allclose(expression.rms[:3], [0.5, 4.0, 0.5])
    np.testing.assert_allclose(expression.far_share[:3], [0, 1, 0])
    assert expression.largest == 4.0
    assert found.visible_parts() == {"jaw": 0.0, "brows": 1.0, "nose": 1.0, "eyes": 1.0, "mouth": 1.0}
    assert found.kinds == {"geometry": {"fitted": 149, HOSTILE: 1}, "id": found.kinds["id"]}
    assert len(found.kinds["id"]) == 150
    assert found.numbers == {"residual_px": (0.0, 74.5, 149.0)}
    rare = found.rare()
    assert "yaw -15 to 180 °: 1 of 150 (0.67 %)" in rare
    assert "yaw -180 to -30 °: 0 of 150 (0.00 %)" in rare
    assert "face size 256 px and more: 0 of 150 (0.00 %)" in rare
    assert "roll 15 to 180 °: 0 of 150 (0.00 %)" in rare
    assert f"landmarks seen in less than 1 %: {', '.join(map(str, range(17)))}" in rare
    assert f"geometry {HOSTILE!r}: 1 of 150 (0.67 %)" in rare
    assert "id, 138 more values: 138 of 150 (92.00 %)" in rare
    assert not any(line.startswith(("roll -60", "pitch 0 to")) for line in rare)


def test_neighbouring_rare_ranges_are_one() -> None:
    edges, counts = np.array([0.0, 1, 2, 3, 4, np.inf]), np.array([0, 0, 999, 0, 1])
    assert Histogram("size", "px", edges, counts, 1000).rare() == [
        "size 0 to 2 px: 0 of 1000 (0.00 %)",
        "size 3 px and more: 1 of 1000 (0.10 %)",
    ]
    assert Histogram("size", "px", edges, np.full(5, 200), 1000).rare() == []


@given(counts=st.lists(st.integers(0, 30), min_size=1, max_size=12))
def test_every_rare_range_is_named_once(counts: list[int]) -> None:
    n_samples = 1000
    edges = np.arange(len(counts) + 1.0)
    found = Histogram("x", "px", edges, np.array(counts), n_samples).rare()
    named: list[int] = []
    for line in found:
        low, high, n = (int(text) for text in re.fullmatch(r"x (\d+) to (\d+) px: (\d+) of .*", line).groups())  # type: ignore[union-attr]
        assert n == sum(counts[low:high])
        named += range(low, high)
    assert named == [i for i, n in enumerate(counts) if n < 0.01 * n_samples]


def test_names_are_no_kinds_and_odd_values_do_not_count(write: Writer, base: tuple[ShardHeader, Sample]) -> None:
    flat = Camera(np.diag([0.0, 0.0, 0.0, 1.0]))
    odd = {"camera": flat, "landmarks2d": np.ones((68, 2))}
    triplets = [
        replace(base[1], sample_id=str(i), attributes={"name": str(i), "x": float("nan") if i else 2.0})
        for i in range(LARGEST_KINDS + 5)
    ]
    triplets[0] = replace(triplets[0], **odd)
    found = count_samples(write(triplets))
    assert found.kinds == {"name": {}}
    assert found.numbers == {"x": (2.0, 2.0, 2.0)}
    assert sum(histogram(found, "face size").values()) == LARGEST_KINDS + 4
    assert any("too many values" in line for table in listings(found) for text in table.lines for line in text)


def test_sets_without_landmarks_have_no_size_and_no_table(tmp_path: Path, base: tuple[ShardHeader, Sample]) -> None:
    header = replace(base[0], layers=("image", "mask"))
    write_shard(tmp_path / "bare" / "shard-00000.h5", header, [base[1]])
    found = count_samples(tmp_path / "bare")
    assert [one.name for one in found.histograms] == ["pitch", "yaw", "roll"]
    assert found.visible_parts() == {}
    assert "landmarks seen" not in [table.title for table in listings(found)]
    assert len(statistics_picture(found).axes) == 5


def test_sets_of_two_models_are_refused(write: Writer, base: tuple[ShardHeader, Sample], tmp_path: Path) -> None:
    folder = write([base[1]])
    write_shard(folder / "shard-00001.h5", base[0], [replace(base[1], sample_id="x", identity=np.zeros(3))])
    with pytest.raises(UsageError, match=r"x: expected .* coefficients as in the samples before, found 3; count the"):
        count_samples(folder)
    few = {name: getattr(base[1], name)[:5] for name in ("landmarks2d", "landmarks3d", "visible")}
    write_shard(folder / "shard-00001.h5", base[0], [replace(base[1], sample_id="x", **few)])
    with pytest.raises(UsageError, match="expected 68 landmarks as in the samples before, found 5"):
        count_samples(folder)


def test_empty_sets_are_refused(write: Writer, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="found empty shards; see rejected"):
        count_samples(write([]))
    with pytest.raises(UsageError, match="no such folder"):
        count_samples(tmp_path / "nowhere")


class Cells(HTMLParser):
    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.texts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_a_page_has_every_table_and_no_foreign_markup(write: Writer, base: tuple[ShardHeader, Sample]) -> None:
    triplets = [
        replace(base[1], sample_id=str(i), attributes={HOSTILE: f"{HOSTILE} {i % (N_KINDS_SHOWN + 8)}"})
        for i in range(N_KINDS_SHOWN + 9)
    ]
    found = count_samples(write(triplets))
    page = Cells(statistics_page(HOSTILE, found))
    assert "script" not in page.tags
    assert page.tags.count("img") == 1
    assert page.tags.count("table") == len(listings(found))
    assert HOSTILE in page.texts
    assert f"{HOSTILE} 3" in page.texts
    assert "8 others" in page.texts


def test_the_summary_of_a_large_set_fits_on_two_screens() -> None:
    n = 1000
    kinds = {f"attribute.{i}": {"often": 900, **{f"value {j}": 10 if j else 1 for j in range(10)}} for i in range(60)}
    found = DatasetStatistics(
        n_samples=n,
        n_shards=9,
        picture_sizes={f"{size} x {size}": 10 for size in range(100, 200)},
        histograms=tuple(Histogram.of(name, np.arange(-45.0, 60.0, 0.105), n) for name in QUANTITIES),
        coefficients=(CoefficientStatistics("identity", np.ones(80), np.zeros(80), 2.5),) * 2,
        visible_share=np.full(68, 0.9),
        kinds=kinds,
        numbers={f"number.{i}": (0.0, 1.0, 2.0) for i in range(200)},
        doubtful=tuple((f"sample {i}", "the face looks away") for i in range(50)),
    )
    out = Console(file=io.StringIO(), width=100)
    print_summary(out, found)
    printed = out.file.getvalue()
    assert printed.count("\n") <= 2 * 48
    assert printed.startswith("ground truth that cannot be true")
    cells = [[cell.strip() for cell in line.strip("│").split("│")] for line in printed.splitlines()]
    assert ["yaw", "-45 to 60 °", "-45 to -30 °", "14.30 %"] in cells
    assert ["attribute.3", "11", "often", "90.00 %", "1"] in cells
    assert ["28 more", "", "", "", ""] in cells
    assert "200 attributes are numbers; --all prints everything" in printed


def test_the_command_prints_tables_json_page_and_picture(
    write: Writer, base: tuple[ShardHeader, Sample], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write([replace(base[1], sample_id=str(i), attributes={"kind": HOSTILE}) for i in range(4)])
    assert main(["stats", str(folder), "--out", str(tmp_path / "deep" / "stats.html")]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("4 samples in 1 shard\n")
    assert "rare, less than 1 % of the samples each" in printed
    assert "  yaw 15 to 180 °: 0 of 4 (0.00 %)" in printed
    assert "\x1b" not in printed
    assert "<h1>Statistics of" in (tmp_path / "deep" / "stats.html").read_text(encoding="utf-8")
    assert "attribute kind" not in printed
    assert main(["stats", str(folder), "--all"]) == 0
    whole = capsys.readouterr().out
    assert "attribute kind" in whole
    assert "\x1b" not in whole
    assert main(["stats", str(folder), "--json", "--out", str(tmp_path / "stats.png")]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["n_samples"] == 4
    assert sum(figures["histograms"]["yaw"]["counts"]) == 4
    assert figures["histograms"]["face size"]["edges"][-1] is None
    assert figures["attribute_kinds"] == {"kind": {HOSTILE: 4}}
    picture = cv2.imread(str(tmp_path / "stats.png"))
    assert picture.shape == (700, 1200, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20


def test_the_same_statistics_give_the_same_picture(write: Writer, base: tuple[ShardHeader, Sample]) -> None:
    found = count_samples(write([base[1]]))
    assert picture_png(statistics_picture(found)) == picture_png(statistics_picture(found))


def test_only_what_fulfils_a_condition_is_counted(write: Writer, base: tuple[ShardHeader, Sample]) -> None:
    triplets = [
        replace(base[1], sample_id=str(i), attributes={"yaw_deg": 10.0 * i, "light": "sun" if i else "night"})
        for i in range(8)
    ]
    folder = write(triplets)
    found = count_samples(folder, where="yaw_deg < 45 and light != 'night'")
    assert found.n_samples == 4
    assert found.numbers == {"yaw_deg": (10.0, 25.0, 40.0)}
    assert found.kinds == {"light": {"sun": 4}}
    with pytest.raises(UsageError, match=r"--where 'yaw > 3': expected attributes among light, sample_id, yaw_deg"):
        count_samples(folder, where="yaw > 3")
    with pytest.raises(UsageError, match=r"expected samples that --where lets pass, found none"):
        count_samples(folder, where="yaw_deg > 300")
