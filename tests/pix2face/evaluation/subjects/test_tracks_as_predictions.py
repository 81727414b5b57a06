"""Tracks of clips become predictions of their annotated frames, by number or by picture."""

import json

import numpy as np
import pytest

from pix2face.errors import InputFileError, UsageError
from pix2face.evaluation.cli import main
from pix2face.evaluation.subjects.predictions_file import read_tracks
from tests.pix2face.benchmark_files import frontal_camera, landmarks_of, write_photograph, write_pts
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
LANDMARKS = landmarks_of(MODEL, frontal_camera())


def write_track(folder, n, **changes):
    """Frame i is i pixels to the right."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {
        "frame": np.arange(n),
        "landmarks2d": np.stack([LANDMARKS + [frame, 0] for frame in range(n)]).astype(np.float32),
        "landmarks3d": np.ones((n, 68, 3), dtype=np.float32),
        "pose_deg": np.zeros((n, 3), dtype=np.float32),
        "fps": np.array(25.0),
    }
    np.savez(folder / "track.npz", **(arrays | changes))


def test_frames_of_videos_count_from_one_and_pictures_have_names(tmp_path):
    write_track(tmp_path / "114", 3)
    write_track(tmp_path / "401", 2)
    known = {"114/000001", "114/000003", "401/000732"}
    predicted = read_tracks(tmp_path, known, {"401": ("000731", "000732")})
    assert predicted.names == ("114/000001", "114/000003", "401/000732")
    np.testing.assert_allclose(predicted.landmarks2d[:, 0, 0] - LANDMARKS[0, 0], [0, 2, 1], atol=1e-4)


@pytest.mark.usefixtures("small_model")
def test_tracks_are_measured_as_they_are(tmp_path, capsys):
    for frame in ("000731", "000733"):
        write_photograph(tmp_path / "data" / "401" / "imgs" / f"{frame}.jpg")
        write_pts(tmp_path / "data" / "401" / "annot" / f"{frame}.pts", LANDMARKS)
    write_track(tmp_path / "tracks" / "401", 2)
    call = ["--split", "300vw", "--data", tmp_path / "data", "--predictions", tmp_path / "tracks"]
    call += ["--out", tmp_path / "o", "--allow-missing"]
    assert main([str(word) for word in call]) == 0
    report = json.loads((tmp_path / "o" / "report.json").read_text())
    eyes = np.linalg.norm(LANDMARKS[45] - LANDMARKS[36])
    assert [face["errors"]["68"] for face in report["faces"]] == pytest.approx([0, 1 / eyes], abs=1e-6)
    capsys.readouterr()
    (tmp_path / "tracks" / "401").rename(tmp_path / "tracks" / "402")
    assert main([str(word) for word in call]) == 2
    error = capsys.readouterr().err
    assert "expected CLIP/track.npz of clips such as 401, found none; write them with" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"landmarks2d": np.zeros((2, 51, 2))},
        {"pose_deg": np.zeros((3, 3))},
        {"frame": np.zeros(2, dtype=int)},
        {"landmarks3d": np.zeros((2, 68, 3)).astype(str)},
    ],
)
def test_tracks_that_cannot_be_meant_are_refused(tmp_path, changes):
    write_track(tmp_path / "114", 2, **changes)
    with pytest.raises(InputFileError, match=r"track\.npz: expected"):
        read_tracks(tmp_path, {"114/000001"}, {})


def test_damaged_and_absent_tracks_are_named(tmp_path):
    write_track(tmp_path / "114", 2)
    whole = (tmp_path / "114" / "track.npz").read_bytes()
    (tmp_path / "114" / "track.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputFileError, match=r"114.track\.npz: expected what pix2face track wrote"):
        read_tracks(tmp_path, {"114/000001"}, {})
    with pytest.raises(UsageError, match="clips such as 114"):
        read_tracks(tmp_path / "absent", {"114/000001"}, {})
