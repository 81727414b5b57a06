"""The report says every convention, and writes files that read back."""

import json
import re
from datetime import UTC, datetime
from io import StringIO

import cv2
import numpy as np
import pytest
from rich.console import Console

from pix2face.errors import UsageError
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace, Unreadable
from pix2face.evaluation.benchmarks.manifest import load_manifest
from pix2face.evaluation.evaluator import Evaluator, frontal_landmarks
from pix2face.evaluation.report.evaluation_report import EvaluationSettings, Report, make_report
from pix2face.evaluation.report.report_files import write_report
from pix2face.evaluation.report.report_pictures import TRUE_RGB, cases_sheet, draw_outlined_landmarks, face_svg
from pix2face.evaluation.report.report_text import all_tables, main_table, report_notes, report_tables
from pix2face.evaluation.report.table_text import SHORT_GROUPS
from pix2face.evaluation.subjects.predictions_file import read_predictions
from pix2face.evaluation.subjects.subjects import NetworkSubject
from pix2face.geometry.crops import FaceBox
from tests.pix2face.benchmark_files import StubPredictor, fit_that_fails, frontal_camera, landmarks_of, stub_fit
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
TRUTH = landmarks_of(MODEL, frontal_camera())
NASTY = 'a<b>&"[red]é'


def face(name: str, group: str = "ibug") -> BenchmarkFace:
    image = np.full((200, 200, 3), 90, dtype=np.uint8)
    facts = {"image": image, "read_image": lambda: image, "yaw_deg": 12.0, "has_unusual_angle": True}
    return BenchmarkFace(name=name, group=group, landmarks2d=TRUTH, **facts)


SETTINGS = EvaluationSettings(method="network")
FRONT = frontal_landmarks(MODEL)
FACES = [face("good"), face(NASTY), face("no fit")]


def report_of(split: str = "ibug", group: str = "ibug") -> Report:
    crop = StubPredictor().predict(FaceBox.around(TRUTH)).crop
    fits = [
        lambda m, c: stub_fit(crop.to_crop(TRUTH + [1, 0])),
        lambda m, c: stub_fit(crop.to_crop(TRUTH + [9, 0])),
        fit_that_fails,
    ]
    results = [
        Evaluator(MODEL, NetworkSubject(StubPredictor(), fit), "outer-eye").evaluate([face(loaded.name, group)])[0]
        for loaded, fit in zip(FACES, fits, strict=True)
    ]
    missing = [f"ibug/gone_{i}.jpg" for i in range(12)]
    subject = {"checkpoint": "runs/x (epoch 3)", "hashes": {"checkpoint": "ab"}}
    return make_report(load_manifest(split), SETTINGS, subject, results, missing, [Unreadable(NASTY, "NaN in <file>")])


def printed(report: Report, width: int = 200) -> str:
    console = Console(file=StringIO(), width=width)
    for table in report_tables(report):
        console.print(table)
    return console.file.getvalue()


def test_files_are_written_and_read_back(tmp_path):
    report = report_of()
    by_name = {loaded.name: loaded for loaded in FACES}
    worst, best = ([(by_name[own.name], own) for own in chosen] for chosen in (report.worst(12), report.best(12)))
    written = write_report(report, worst, best, FRONT, tmp_path / "new")
    pictures = ["best.jpg", "curve.png", "worst.jpg"]
    assert sorted(path.name for path in written) == sorted([*pictures, "index.html", "landmarks.npz", "report.json"])
    for name in pictures:
        assert cv2.imread(str(tmp_path / "new" / name)).std() > 1
    stored = json.loads((tmp_path / "new" / "report.json").read_text())
    assert (stored["n_evaluated"], stored["n_failed"], stored["n_missing"], stored["n_unreadable"]) == (3, 1, 12, 1)
    assert stored["missing"][-1] == "ibug/gone_11.jpg"
    assert stored["subject"]["hashes"]["checkpoint"] == "ab"
    assert stored["benchmark"]["normaliser"] == "outer-eye"
    assert stored["faces"][2]["errors"] == {"68": None, "51": None}
    good, bad = (loaded["errors"]["68"] for loaded in stored["faces"][:2])
    assert stored["table"][0]["all_images"]["mean"] == pytest.approx((good + bad) / 2)
    assert bad == pytest.approx(9 * good)


def test_every_figure_of_the_table_is_in_the_json(tmp_path):
    report = report_of("aflw2000-3d", "|yaw| <= 30°")
    write_report(report, [], [], FRONT, tmp_path)
    table = json.loads((tmp_path / "report.json").read_text())["table"]
    _, columns, lines = main_table(report)
    for row, line in zip(table, lines, strict=False):
        cells = dict(zip(columns, line, strict=True))
        assert cells["to 30°"] == f"{100 * row['groups']['|yaw| <= 30°']['mean']:.2f}"
        assert cells["above"] == cells["mean of bins"] == "–"
        assert row["mean_of_groups"] is None
        assert cells["median"] == f"{100 * row['all_images']['median']:.2f}"
        assert cells["AUC to 10 %"] == f"{100 * row['all_images']['area_under_curve']:.1f}"
        assert cells["above 10 %"] == f"{100 * row['all_images']['failure_rate']:.1f}"
        assert cells["not found"] == str(row["all_images"]["n_failed"])
    assert lines[-1][:3] == ["images", "–", "3"]


def test_the_page_needs_nothing_beside_it_and_shows_every_table(tmp_path):
    report = report_of("aflw2000-3d", "|yaw| <= 30°")
    write_report(report, [(FACES[0], report.results[0])], [], FRONT, tmp_path)
    page = (tmp_path / "index.html").read_text()
    sources = re.findall(r'(?:src|href)="([^"]{0,22})', page)
    assert sources == ["data:image/png;base64,", *["data:image/jpeg;base64"] * 2]
    assert page.count("<table>") == len(all_tables(report)) == 3  # figures, intervals, parts
    assert page.count("<circle") == 68
    for column in SHORT_GROUPS.values():
        assert f"<th>{column}</th>" in page


def test_the_page_says_what_was_measured_when_and_in_which_unit(tmp_path):
    report = report_of("aflw2000-3d", "|yaw| <= 30°")
    write_report(report, [], [], FRONT, tmp_path)
    page = (tmp_path / "index.html").read_text()
    assert f"network: runs/x (epoch 3). Evaluated on {datetime.now(UTC):%Y-%m-%d}" in page
    captions = re.findall("<caption>(.*?)</caption>", page)
    assert len(captions) == len(all_tables(report))
    normaliser = "in % of the sqrt(width x height) of the tight box of the true 68 points"
    assert all(normaliser in caption for caption in captions)
    assert "unweighted mean of the bins" in captions[0]
    largest = 100 * report.mean_of_landmarks().max()
    labels = [float(label) for label in re.findall(r'<text x="[\d.]+" y="[\d.]+">([\d.]+)</text>', page)]
    assert labels == pytest.approx(np.linspace(0, largest, 5), abs=0.051)
    assert f"mean error, {normaliser.removeprefix('in ')}" in page


def test_the_drawn_face_has_the_largest_disc_at_the_worst_landmark():
    means = np.linspace(0.01, 0.02, 68)
    means[30] = 0.08
    drawn = face_svg(means, FRONT)
    discs = {
        int(number): (float(x), float(y), float(radius), figure)
        for x, y, radius, number, figure in re.findall(
            r'cx="([\d.]+)" cy="([\d.]+)" r="([\d.]+)"[^>]*><title>point (\d+): ([\d.]+) %', drawn
        )
    }
    assert sorted(discs) == list(range(1, 69))
    assert max(discs, key=lambda number: discs[number][2]) == 31
    assert discs[31][3] == "8.00"
    # Area by error: an eighth of the error has an eighth of the area.
    assert discs[1][2] == pytest.approx(discs[31][2] * np.sqrt(0.01 / 0.08), abs=0.06)
    assert discs[37][0] < discs[46][0]  # the subject's right eye is on the left
    assert discs[20][1] < discs[31][1] < discs[9][1]  # brow above nose above chin
    unknown = face_svg(np.full(68, np.nan), FRONT)
    assert unknown.count(": unknown</title>") == 68
    assert "nan" not in unknown


def test_found_landmarks_are_written_as_predictions(tmp_path):
    report = report_of()
    write_report(report, [], [], FRONT, tmp_path)
    predicted = read_predictions(tmp_path / "landmarks.npz")
    assert predicted.names == ("good", NASTY, "no fit")
    np.testing.assert_allclose(predicted.landmarks2d[0], TRUTH + [1, 0], atol=1e-9)
    assert np.isnan(predicted.landmarks2d[2]).all()


def test_faces_that_were_not_found_are_counted_with_the_error_of_the_baseline_beside_the_mean():
    report = report_of()
    row = report.rows[0]
    good, bad, failed = report.results
    by_hand = (good.error() + bad.error() + failed.error("68", "baseline")) / 3
    assert row.mean_failures_as_baseline == pytest.approx(by_hand)
    assert (
        f"Were the 1 not found given the error of the baseline, the mean over images would be {100 * by_hand:.2f} %"
        in ("\n".join(report_notes(report)))
    )


def test_parts_and_landmarks_are_means_over_the_faces_found(tmp_path):
    report = report_of()
    write_report(report, [], [], FRONT, tmp_path)
    stored = json.loads((tmp_path / "report.json").read_text())
    means = np.mean([result.landmark_errors for result in report.results[:2]], axis=0)
    np.testing.assert_allclose(stored["landmarks"]["network"], means)
    assert stored["parts"]["network"]["mouth"] == pytest.approx(means[48:68].mean())
    assert stored["parts"]["network"]["eyes"] == pytest.approx(means[36:48].mean())
    assert stored["faces"][0]["parts"]["jaw"] == pytest.approx(report.results[0].landmark_errors[:17].mean())
    assert stored["faces"][2]["landmarks"] == [None] * 68


def test_every_headline_figure_has_an_interval_around_it(tmp_path):
    report = report_of()
    write_report(report, [], [], FRONT, tmp_path)
    stored = json.loads((tmp_path / "report.json").read_text())
    assert stored["bootstrap"] == {"n_resamples": 1000, "seed": 0, "confidence": 0.95, "drawn": "images"}
    for row in stored["table"]:
        for name in ("mean", "median", "area_under_curve", "failure_rate"):
            low, high = row["intervals"][name]
            assert low <= row["all_images"][name] <= high
    assert "1000 resamples, seed 0" in "\n".join(report_notes(report))


def test_notes_state_every_convention():
    notes = "\n".join(report_notes(report_of("aflw2000-3d", "|yaw| <= 30°")))
    for said in (
        "3 of 2000",
        "box-sqrt",
        "pt3d_68",
        "not the re-annotated landmarks (--truth reannotated)",
        "their unweighted mean, the headline",
        "mean face's landmarks",
        "tight box of the true 68",
        "3 images with an angle beyond ±99°",
        "12 missing: ibug/gone_0.jpg",
        "ibug/gone_9.jpg and 2 more",
        "1 unreadable",
        "1 not found: no fit (expected 50 valid pixels",
        "checkpoint: runs/x (epoch 3)",
    ):
        assert said in notes
    assert "gone_10" not in notes


def test_table_has_the_baseline_and_no_column_for_a_single_part():
    text = printed(report_of())
    baseline = [line.split()[:2] for line in text.splitlines() if line.startswith("baseline")]
    assert baseline[:2] == [["baseline", "68"], ["baseline", "51"]]
    assert "above 8 %" in main_table(report_of()).columns
    assert "mean of bins" not in text
    assert main_table(report_of()).columns[2] == "mean of images"


def test_the_widest_table_fits_into_80_columns():
    report = report_of("aflw2000-3d", "|yaw| <= 30°")
    text = printed(report, 80)
    assert "…" not in text
    lines = [line.split() for line in text.splitlines()]
    assert [line[-2:] for line in lines if line[:1] == ["network"]][:2] == [["66.7", "1"]] * 2


def test_names_are_escaped_on_the_page(tmp_path):
    write_report(report_of(), [], [], FRONT, tmp_path)
    page = (tmp_path / "index.html").read_text()
    assert "a&lt;b&gt;&amp;&quot;[red]é" in page
    assert "<file>" not in page
    assert "<b>" not in page
    assert "http" not in page


def test_a_report_without_faces_can_be_written(tmp_path):
    report = make_report(load_manifest("ibug"), SETTINGS, {}, [], [], [Unreadable("all", "damaged")])
    write_report(report, [], [], FRONT, tmp_path)
    assert "–" in printed(report)


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="file"):
        write_report(report_of(), [], [], FRONT, tmp_path / "file" / "below")


def test_landmarks_are_drawn_where_they_are():
    image = np.zeros((200, 200, 3), dtype=np.uint8)
    draw_outlined_landmarks(image, TRUTH, TRUE_RGB)
    for x, y in TRUTH:
        assert tuple(image[int(y), int(x)]) == TRUE_RGB
    assert image[0].max() == image[:, 0].max() == 0


@pytest.mark.parametrize("n", [0, 1, 3, 4, 5])
def test_sheet_holds_every_case(n):
    result = report_of().results[0]
    sheet = cases_sheet([(FACES[0], result)] * n)
    columns, rows = min(max(n, 1), 4), max(-(-n // 4), 1)
    assert sheet.shape == (56 + rows * 320, columns * 280, 3)
    named = cases_sheet([(FACES[0], result)] * n, "Worst cases")
    assert (named[:28] != sheet[:28]).any()
    np.testing.assert_array_equal(named[28:], sheet[28:])
