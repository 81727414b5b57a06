"""Two reports side by side: what is paired, what is refused, and whether an interval covers what it claims to."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from pix2face.errors import InputFileError, UsageError
from pix2face.evaluation.cli import main
from pix2face.evaluation.figures.bootstrap import Bootstrap
from pix2face.evaluation.report.compare import StoredReport, compare_reports, read_report

BENCHMARK = {
    "split": "ibug", "truth": "hand-marked", "normaliser": "outer-eye", "threshold": 0.08, "box_rule": "true",
    "title": "iBUG",
}  # fmt: skip


def stored(errors, path="a.json", clips=None, **changes) -> StoredReport:
    by_name = {f"face {index}": error for index, error in enumerate(errors)}
    clips = dict(zip(by_name, clips, strict=True)) if clips else {name: name for name in by_name}
    errors_of_points = {"68": by_name, "51": by_name}
    return StoredReport(Path(path), {**BENCHMARK, **changes}, "network", errors_of_points, clips, "those of the model")


def report_json(errors, **changes):
    faces = [
        {"name": f"face {index}", "clip": None, "errors": {"68": error, "51": error}}
        for index, error in enumerate(errors)
    ]
    content = {"format": "pix2face-evaluation", "schema_version": 2, "method": "network", "benchmark": BENCHMARK}
    content["subject"] = {"landmarks": "those of the model"}
    return {**content, "faces": faces, **changes}


def test_figures_of_a_comparison_by_hand():
    a = stored([0.02, 0.04, 0.10, math.inf, 0.05])
    b = stored([0.01, 0.06, 0.07, 0.05, math.inf])
    own = compare_reports(a, b, Bootstrap(50)).points["68"]
    assert own.n_both_found == 3
    assert own.difference == pytest.approx((-0.01 + 0.02 - 0.03) / 3)
    assert (own.mean_a, own.mean_b) == pytest.approx((0.16 / 3, 0.14 / 3))
    assert (own.share_b_better, own.share_a_better) == (3 / 5, 2 / 5)
    area_a = ((1 - 0.02 / 0.08) + (1 - 0.04 / 0.08) + (1 - 0.05 / 0.08)) / 5
    area_b = ((1 - 0.01 / 0.08) + (1 - 0.06 / 0.08) + (1 - 0.07 / 0.08) + (1 - 0.05 / 0.08)) / 5
    assert own.difference_of_area == pytest.approx(area_b - area_a)
    assert own.difference_of_failure_rate == pytest.approx(1 / 5 - 2 / 5)


def test_a_report_does_not_differ_from_itself():
    a = stored([0.02, 0.04, math.inf])
    own = compare_reports(a, a, Bootstrap(50)).points["68"]
    assert (own.difference, own.share_a_better, own.share_b_better) == (0, 0, 0)
    assert own.intervals["difference"] == (0, 0)


def test_pairing_finds_a_difference_that_two_separate_intervals_would_not():
    random = np.random.default_rng(0)
    hardness = random.gamma(2, 0.02, 200)
    a = stored(hardness)
    b = stored(hardness + 0.001 + random.normal(0, 0.002, 200).clip(-0.001))
    low, high = compare_reports(a, b, Bootstrap(1000)).points["68"].intervals["difference"]
    assert 0 < low < high
    assert high - low < 0.1 * 4 * hardness.std() / math.sqrt(200)


def test_frames_of_a_clip_are_drawn_together():
    errors, clips = np.repeat([0.02, 0.03, 0.05], 30), [str(index // 30) for index in range(90)]
    other = errors + np.repeat([0.01, -0.01, 0.002], 30)
    together = compare_reports(stored(errors, clips=clips), stored(other, clips=clips), Bootstrap(500))
    apart = compare_reports(stored(errors), stored(other), Bootstrap(500))
    assert (together.n_drawn, apart.n_drawn) == (3, 90)
    widths = [np.ptp(own.points["68"].intervals["difference"]) for own in (together, apart)]
    assert widths[0] > 3 * widths[1]


@pytest.mark.parametrize(
    ("key", "other"), [("split", "300w-full"), ("truth", "x"), ("normaliser", "box-sqrt"), ("threshold", 0.1)]
)
def test_reports_whose_errors_mean_something_else_are_refused(key, other):
    with pytest.raises(UsageError, match=f"same {key}, found .* in a.json and .* in b.json"):
        compare_reports(stored([0.1]), stored([0.1], "b.json", **{key: other}), Bootstrap())


def test_reports_without_a_common_face_are_refused():
    errors = {"68": {"x": 0.1}, "51": {"x": 0.1}}
    other = StoredReport(Path("b.json"), BENCHMARK, "network", errors, {"x": "x"}, "those of the model")
    with pytest.raises(UsageError, match="faces in common"):
        compare_reports(stored([0.1]), other, Bootstrap())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "found something else"),
        ('{"format": "pix2', "found something else"),
        ("\xff", "found something else"),
        ("[" * 100000, "found something else"),
        ("[]", "Expected `object`, got `array`"),
        ('{"a": 1}', "found other JSON"),
        (json.dumps(report_json([0.1], schema_version=1)), "expected schema 2, found 1"),
        (json.dumps(report_json([0.1], benchmark={})), "damaged: 'split'"),
        (json.dumps(report_json([0.1], benchmark={**BENCHMARK, "threshold": "x"})), "damaged"),
        (json.dumps(report_json([0.1], benchmark={**BENCHMARK, "threshold": 10**400})), "damaged"),
        (json.dumps(report_json([0.1], faces=[1])), "damaged"),
        (json.dumps(report_json([0.1], faces=None)), "damaged"),
        (json.dumps(report_json(["0.1"])), "damaged"),
        (json.dumps(report_json([-0.1])), "damaged: an error of -0.1"),
        (json.dumps(report_json([1e308])), "damaged: an error of 1e"),
        (json.dumps(report_json([0.1], benchmark={**BENCHMARK, "threshold": 0})), "a threshold of 0"),
        (json.dumps(report_json([float("nan")])), "NaN is not finite"),
        (json.dumps(report_json([0.1], faces=report_json([0.1])["faces"] * 2)), "a face is in it twice"),
    ],
)
def test_files_that_are_no_report_are_refused_in_a_line(tmp_path, capsys, text, message):
    (tmp_path / "a.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputFileError, match=message):
        read_report(tmp_path / "a.json")
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "a.json")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "a.json" in error


def test_who_finds_the_easy_faces_alone_is_not_better(tmp_path, capsys):
    """Its mean is smaller, over the faces that it found."""
    (tmp_path / "a.json").write_text(json.dumps(report_json([0.05] * 40)))
    (tmp_path / "b.json").write_text(json.dumps(report_json([*[0.01] * 4, *[None] * 36])))
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json")]) == 0
    last = " ".join(capsys.readouterr().out.split())
    assert last.endswith(
        "A is better (68 points, all images): the interval of the difference of the AUC excludes 0. "
        "Both found 4 of 40 images; over all of them A is better on 90.00 %, B on 10.00 %."
    )


def test_the_command_prints_a_table_and_writes_its_figures(tmp_path, capsys):
    random = np.random.default_rng(0)
    first = random.uniform(0.02, 0.06, 40).tolist()
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "report.json").write_text(json.dumps(report_json([*first, None])))
    other = report_json([own - 0.01 for own in first], subject={"landmarks": "those that the checkpoint brings along"})
    (tmp_path / "b.json").write_text(json.dumps(other))
    call = ["compare", str(tmp_path / "a"), str(tmp_path / "b.json"), "--out", str(tmp_path / "new" / "c.json")]
    assert main(call) == 0
    printed = capsys.readouterr().out
    assert "NOT of the same images: 40 in common (all figures are over these), 1 in A alone, 0 in B alone." in printed
    assert "B is better (68 points)" in printed
    assert "landmarks: those of the model)" in printed
    assert "landmarks: those that the checkpoint brings along)" in printed
    assert "-1.00 (-1.00 to -1.00)" in printed
    facts = json.loads((tmp_path / "new" / "c.json").read_text())
    assert facts["points"]["68"]["difference"] == pytest.approx(-0.01)
    assert facts["points"]["68"]["share_b_better"] == 1
    assert facts["bootstrap"] == {"n_resamples": 1000, "seed": 0}
    assert "that both found" not in printed.splitlines()[-1]
    assert main([*call[:3], "--resamples", "0"]) == 2
    assert "--resamples from 1" in capsys.readouterr().err
    assert main([*call[:3], "--out", str(tmp_path)]) == 2


def test_equal_systems_are_told_apart_as_often_as_the_interval_admits():
    """Of pairs that differ by chance alone, 95 of 100 intervals hold zero, give or take."""
    random = np.random.default_rng(1)
    holds_zero = 0
    for trial in range(120):
        hardness = random.gamma(2, 0.02, 80)
        a, b = (stored(hardness + np.abs(random.normal(0, 0.01, 80))) for _ in range(2))
        low, high = compare_reports(a, b, Bootstrap(200, trial)).points["68"].intervals["difference"]
        holds_zero += low <= 0 <= high
    assert 105 <= holds_zero <= 120
