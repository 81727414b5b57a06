"""The command from its arguments to files and exit status, with a network that has learned nothing."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pix2face.detectors.detection import DetectedFace
from pix2face.evaluation.benchmarks.manifest import load_manifest
from pix2face.evaluation.cli import main
from pix2face.fitting.face_fit import fit_face
from pix2face.geometry.crops import FaceBox
from tests.pix2face.benchmark_files import write_heldout, write_mat, write_photograph
from tests.pix2face.evaluation_calls import (
    LANDMARKS,
    MODEL,
    measure,
    predictions_for,
    run,
    stored_report,
    write_checkpoint,
    write_ibug,
)

pytestmark = pytest.mark.usefixtures("curves_are_not_drawn")


def test_photographs_give_a_table_and_files_with_every_face_counted(tmp_path, small_model, capsys):
    write_ibug(tmp_path)
    assert run(tmp_path, "--data", tmp_path) == 0
    printed = capsys.readouterr().out
    assert "Row baseline: the mean face" in printed
    assert "133 missing: ibug/image_005_1.jpg" in printed
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert (report["n_evaluated"], report["n_missing"]) == (2, 133)
    assert report["subject"]["configuration"]["split"] == "ibug"
    assert report["subject"]["checkpoint_header"]["configuration"] == {"preset": "test"}
    assert len(report["subject"]["hashes"]["checkpoint"]) == 64
    assert report["table"][2]["all_images"]["mean"] == pytest.approx(0, abs=1e-6)  # the mean face itself


def test_a_part_of_a_benchmark_is_called_one_in_every_title_and_by_the_exit_status(tmp_path, small_model, capsys):
    write_ibug(tmp_path)
    predictions = predictions_for(tmp_path / "other.npz", ["image_003_1", "image_004_1"])
    call = ["--split", "ibug", "--data", tmp_path, "--predictions", predictions, "--out", tmp_path / "out"]
    call = [str(own) for own in (*call, "--resamples", 0)]
    assert main(call) == 3
    printed = capsys.readouterr()
    title = "300-W, challenging subset: iBUG; only 2 of 135 images"
    assert " ".join(printed.out.split()).startswith(title)
    assert printed.err.endswith(f"{title}: the exit status is 3; --allow-missing accepts missing files\n")
    assert f"<h1>{title}</h1>" in (tmp_path / "out" / "index.html").read_text()
    assert stored_report(tmp_path)["benchmark"]["title"] == title
    assert main([*call, "--allow-missing"]) == 0
    printed = capsys.readouterr()
    assert " ".join(printed.out.split()).startswith(title)
    assert "exit status" not in printed.err


def test_a_whole_benchmark_is_no_part(tmp_path, small_model, capsys, monkeypatch):
    write_heldout(tmp_path / "shards", MODEL, n=2)
    whole = replace(load_manifest("builtin-heldout"), n_samples=2)
    monkeypatch.setattr("pix2face.evaluation.evaluate_cli.load_manifest", lambda split: whole)
    call = ["--split", "builtin-heldout", "--data", tmp_path / "shards", "--oracle", "--out", tmp_path / "out"]
    assert main([str(own) for own in (*call, "--resamples", 0)]) == 0
    printed = capsys.readouterr()
    assert stored_report(tmp_path)["benchmark"]["title"] == "held-out faces of the built-in model, rendered"
    assert "; only" not in printed.out
    assert "exit status" not in printed.err


def test_data_folder_from_the_environment(tmp_path, small_model, monkeypatch):
    write_ibug(tmp_path)
    monkeypatch.setenv("PIX2FACE_DATA", str(tmp_path))
    assert run(tmp_path) == 0


def test_without_data_one_line_says_where_it_is(tmp_path, small_model, monkeypatch, capsys):
    monkeypatch.delenv("PIX2FACE_DATA", raising=False)
    assert run(tmp_path) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "iBUG, Imperial College London" in error
    assert "DATA/ibug/image_003_1.jpg" in error


def test_damaged_faces_are_listed_and_decide_the_exit_status(tmp_path, small_model, capsys):
    write_ibug(tmp_path, ("image_003_1", "image_004_1", "image_005_1"))
    damaged = tmp_path / "ibug" / "image_004_1.pts"
    damaged.write_bytes(damaged.read_bytes()[:100])
    assert run(tmp_path, "--data", tmp_path) == 3
    assert "1 unreadable: ibug/image_004_1.jpg" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "report.json").read_text())["n_evaluated"] == 2
    assert run(tmp_path, "--data", tmp_path, "--max-rejected", 1) == 0


def test_fewer_than_no_rejected_faces_are_one_line(tmp_path, small_model, capsys):
    assert run(tmp_path, "--data", tmp_path, "--max-rejected", -1) == 2
    assert capsys.readouterr().err == "evaluate: error: --max-rejected: expected 0 or more, found -1\n"


def test_where_no_face_can_be_evaluated_the_reasons_are_all(tmp_path, small_model, capsys):
    write_ibug(tmp_path)
    for name in ("image_003_1", "image_004_1"):
        (tmp_path / "ibug" / f"{name}.pts").write_bytes(b"version: 1\n")
    assert run(tmp_path, "--data", tmp_path, "--max-rejected", 9) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    reasons = captured.err.splitlines()[-3:-1]
    assert [reason.split(":")[0] for reason in reasons] == ["ibug/image_003_1.jpg", "ibug/image_004_1.jpg"]
    assert captured.err.splitlines()[-1].startswith("evaluate: error: ibug: expected at least one face")
    assert "found 2 unreadable files" in captured.err
    assert not (tmp_path / "out" / "report.json").exists()


def test_yaw_bins_of_aflw(tmp_path, small_model, capsys):
    for name, yaw_deg in (("image00002", 5), ("image00004", 50), ("image00006", -80)):
        write_photograph(tmp_path / f"{name}.jpg")
        write_mat(tmp_path / f"{name}.mat", LANDMARKS, yaw_deg)
    write_mat(tmp_path / "image00006.mat", LANDMARKS, -80, Exp_Para=np.full((29, 1), np.nan))
    assert run(tmp_path, "--data", tmp_path, "--max-rejected", 1, split="aflw2000-3d") == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    groups = report["table"][0]["groups"]
    assert [groups[name]["n_images"] for name in groups] == [1, 1, 0]
    assert report["unreadable"][0]["name"] == "aflw2000-3d/image00006.jpg"


def test_heldout_renders(tmp_path, small_model, capsys):
    write_heldout(tmp_path / "shards", MODEL)
    assert run(tmp_path, "--data", tmp_path / "shards", split="builtin-heldout") == 0
    printed = capsys.readouterr().out
    assert "mask IoU" in printed
    assert "98 missing: seed1000000/0000002, " in printed
    assert json.loads((tmp_path / "out" / "report.json").read_text())["n_missing"] == 98


def test_errors_are_told_apart_by_what_renders_were_drawn_from(tmp_path, small_model, capsys):
    write_heldout(tmp_path / "shards", MODEL, n=8)
    call = ["--data", tmp_path / "shards", "--by", "skin.melanin", "light.kind"]
    assert run(tmp_path, *call, split="builtin-heldout") == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    tones, lights = report["by"]
    assert (tones["attribute"], lights["attribute"]) == ("skin.melanin", "light.kind")
    assert [row["errors"]["n_images"] for row in tones["bins"]] == [2, 2, 2, 2]
    assert [(row["name"], row["errors"]["n_images"]) for row in lights["bins"]] == [("studio", 8)]
    assert lights["bins"][0]["errors"] == report["table"][0]["all_images"]
    printed = capsys.readouterr().out
    assert tones["bins"][0]["name"] in printed
    assert "By skin.melanin, light.kind: 68 points" in printed
    assert tones["bins"][0]["name"] in (tmp_path / "out" / "index.html").read_text()


def test_an_unknown_attribute_is_said_before_evaluating(tmp_path, small_model, monkeypatch, capsys):
    write_heldout(tmp_path / "shards", MODEL)
    monkeypatch.delattr("pix2face.evaluation.evaluate_cli.open_subject")
    assert run(tmp_path, "--data", tmp_path / "shards", "--by", "skin.tone", split="builtin-heldout") == 2
    error = capsys.readouterr().err
    assert "--by 'skin.tone': expected attributes among light.kind, sample_id, seen_share, skin.melanin" in error
    assert error.count("\n") == 1


def test_a_split_of_renders_says_by_itself_what_to_tell_apart(tmp_path, small_model, capsys):
    write_heldout(tmp_path / "shards", MODEL, seed=77)
    assert run(tmp_path, "--data", tmp_path / "shards", split="builtin-photographs") == 0
    by = [own["attribute"] for own in stored_report(tmp_path)["by"]]
    assert by == ["skin.melanin", "abs(yaw_deg)", "seen_share"]


def test_renders_without_what_their_split_takes_say_how_to_make_them(tmp_path, small_model, monkeypatch, capsys):
    monkeypatch.setattr("tests.pix2face.benchmark_files.ATTRIBUTES", {"yaw_deg": 0.0})
    write_heldout(tmp_path / "shards", MODEL, seed=77)
    assert run(tmp_path, "--data", tmp_path / "shards", split="builtin-photographs") == 2
    error = capsys.readouterr().err
    assert "builtin-photographs takes these by itself. To get it: make it: datagen sample" in error
    assert error.count("\n") == 1


def test_faces_that_another_system_did_not_find_are_counted_in_their_bin(tmp_path, small_model):
    write_heldout(tmp_path / "shards", MODEL, n=2)
    predictions = predictions_for(tmp_path / "other.npz", ["seed1000000/0000000"])
    call = ["--data", tmp_path / "shards", "--predictions", predictions, "--by", "skin.melanin"]
    assert measure(tmp_path, *call, split="builtin-heldout") == 0
    light, dark = (row["errors"] for row in stored_report(tmp_path)["by"][0]["bins"])
    assert (light["n_failed"], dark["n_failed"]) == (0, 1)
    assert (dark["mean"], dark["failure_rate"]) == (None, 1)


def test_photographs_have_no_attributes_to_be_told_apart_by(tmp_path, small_model, capsys):
    write_ibug(tmp_path)
    assert run(tmp_path, "--data", tmp_path, "--by", "skin.melanin") == 2
    assert "--by: expected a split of renders, whose attributes are known, found ibug" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("split", "expected"),
    [("ibug", "those that the checkpoint brings along"), ("builtin-heldout", "those of the model")],
)
def test_renders_are_measured_by_the_vertices_that_annotate_them(tmp_path, small_model, monkeypatch, split, expected):
    """A checkpoint's own landmarks stand for how people annotate photographs."""
    measured = []

    def fit(maps, model, *options, **more):
        measured.append(model.landmarks["ibug68"])
        return fit_face(maps, model, *options, **more)

    monkeypatch.setattr("pix2face.evaluation.subjects.measured_subject.fit_face", fit)
    write_ibug(tmp_path)
    write_heldout(tmp_path / "shards-heldout", MODEL)
    write_checkpoint(tmp_path / "checkpoint.safetensors", landmarks={"ibug68": tuple(range(68))})
    assert run(tmp_path, "--data", tmp_path, split=split) == 0
    assert stored_report(tmp_path)["subject"]["landmarks"] == expected
    is_own = expected == "those that the checkpoint brings along"
    np.testing.assert_array_equal(measured[0], range(68) if is_own else MODEL.landmarks["ibug68"])


def test_a_file_in_the_way_of_the_report_is_said_before_evaluating(tmp_path, small_model, monkeypatch, capsys):
    write_ibug(tmp_path)
    (tmp_path / "out").write_bytes(b"kept")
    monkeypatch.delattr("pix2face.evaluation.evaluate_cli.open_subject")
    assert run(tmp_path, "--data", tmp_path) == 2
    error = capsys.readouterr().err
    assert "expected a folder that can be written to, found that" in error
    assert error.count("\n") == 1


def test_checkpoint_of_another_model_names_both(tmp_path, small_model, capsys):
    write_ibug(tmp_path)
    write_checkpoint(tmp_path / "checkpoint.safetensors", "Basel", "e" * 64)
    assert run(tmp_path, "--data", tmp_path) == 2
    error = capsys.readouterr().err
    assert "Basel" in error
    assert MODEL.name in error


class FixedDetector:
    """Finds the same faces in every picture."""

    def __init__(self, *faces):
        self._faces = [DetectedFace(*face) for face in faces]

    def detect(self, image):
        raise AssertionError("scores are wanted")

    def candidates(self, image):
        return self._faces


def test_a_detectors_misses_are_failures(tmp_path, small_model, capsys, monkeypatch):
    write_ibug(tmp_path)
    other = FixedDetector((FaceBox(0, 0, 9, 9), 1.2))
    for detector, found in ((FixedDetector(), "found no face"), (other, "found 1 elsewhere")):
        monkeypatch.setattr(
            "pix2face.evaluation.subjects.measured_subject.open_detector", lambda *call, own=detector: own
        )
        assert run(tmp_path, "--data", tmp_path, "--boxes", "detected", "--no-refine") == 0
        report, printed = stored_report(tmp_path), capsys.readouterr().out
        assert report["n_failed"] == 2
        assert report["table"][0]["all_images"]["mean"] is None
        assert report["table"][0]["all_images"]["failure_rate"] == 1
        assert "Box of the crop: boxes of the detector cnn, as they are" in printed
        assert f"2 not found: ibug/image_003_1.jpg (the detector {found})" in printed
    assert report["detection"]["n_false"] == 2


def test_a_detector_is_measured_on_renders(tmp_path, small_model, capsys, monkeypatch):
    write_heldout(tmp_path / "shards", MODEL, n=4)
    tight = FaceBox.around(LANDMARKS)
    right = FaceBox(tight.left + 4, tight.top, tight.right + 4, tight.bottom)
    faces = ((right, 2.0), (FaceBox(0, 0, 9, 9), 1.1), (FaceBox(9, 0, 18, 9), 0.3))
    monkeypatch.setattr(
        "pix2face.evaluation.subjects.measured_subject.open_detector", lambda *call: FixedDetector(*faces)
    )
    call = ("--data", tmp_path / "shards", "--boxes", "detected", "--no-refine", "--detector", "dlib")
    assert run(tmp_path, *call, split="builtin-heldout") == 0
    report, printed = stored_report(tmp_path), capsys.readouterr().out
    own, face = report["detection"], report["faces"][0]["detection"]
    assert own["all_faces"] == {"name": "all", "n_faces": 4, "n_found": 4, "recall": 1}
    assert sum(each["n_faces"] for each in own["by_yaw"]) == sum(each["n_faces"] for each in own["by_size"]) == 4
    assert (own["n_false"], own["false_per_photograph"]) == (4, 1)
    assert own["median_overlap"] == pytest.approx((tight.width - 4) / (tight.width + 4))
    assert [point["precision"] for point in own["curve"]] == pytest.approx([1, 1 / 2, 1 / 3])
    assert own["average_precision"] == 1
    assert (face["score"], face["n_false"], list(face["box"].values())) == (2.0, 1, pytest.approx([*right.sides, 0]))
    assert "4 false boxes, 1.000 a photograph" in printed
    assert (tmp_path / "out" / "detection.png").read_bytes().startswith(b"\x89PNG")
    assert "Precision and recall of the detector" in (tmp_path / "out" / "index.html").read_text()
    assert run(tmp_path, *call, "--min-score", "1.5", split="builtin-heldout") == 0
    assert stored_report(tmp_path)["detection"]["n_false"] == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--threshold", 0], "expected a positive --threshold"),
        (["--threshold", "nan"], "expected a positive --threshold"),
        (["--batch-size", 0], "--batch-size: expected 1 or more, found 0"),
        (["--resamples", -1], "--resamples: expected 0 or more, found -1"),
        (["--seed", -1], "--seed: expected 0 or more"),
        (["--frame", "1-based"], "--frame 1-based: expected --predictions with it"),
        (["--oracle", "--predictions", "p.npz"], "expected one of --checkpoint, --predictions and --oracle"),
        (["--truth", "reannotated"], "ibug: expected hand-marked as --truth, found reannotated"),
        (["--align", "rigid"], "--align rigid: expected a split with 3D landmarks, found ibug"),
        (["--oracle", "--boxes", "detected"], "--boxes detected: expected a checkpoint"),
        (["--detector", "dlib"], "--detector: expected --boxes detected"),
        (["--no-refine"], "--no-refine: expected --boxes detected"),
        (["--smallest-face", 0.1], "--smallest-face: expected --boxes detected"),
        (["--boxes", "detected", "--smallest-face", 0], "above 0 and at most 1 (--smallest-face 0.02), found 0"),
        (["--boxes", "detected", "--detector", "haar"], "expected a detector of"),
        (["--predictions", "p.npz", "--landmark-type", "2d"], "--landmark-type: expected a checkpoint or --oracle"),
        (["--oracle", "--regularisation", 80], "--regularisation: expected a checkpoint"),
        (["--oracle", "--no-silhouette"], "--no-silhouette: expected a checkpoint"),
        (["--predictions", "p.npz", "--camera", "pinhole"], "--camera: expected a checkpoint or --oracle"),
        (["--reannotated", "x.npy"], "expected --truth reannotated with it"),
        (["--predictions", "absent.npz"], "absent.npz: expected an .npz file of predictions"),
    ],
)
def test_calls_that_cannot_be_meant_are_one_line(tmp_path, small_model, capsys, arguments, message):
    write_ibug(tmp_path)
    assert measure(tmp_path, *arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
