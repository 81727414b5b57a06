"""Verifying shards and folders: damage of every kind is found and named."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from pix2face.errors import InputFileError, UsageError
from pix2face.files.checked_hdf5 import fixed_text
from pix2face.files.images import encode_photograph
from pix2face.shards.sample import JITTER_OF, PICTURE, PictureKind, Sample
from pix2face.shards.shard_checks import verify_folder, verify_shard
from pix2face.shards.shard_writing import write_shard
from tests.cameras import posed_camera
from tests.pix2face.files.test_images import with_orientation
from tests.pix2face.shard_files import HEADER, every_layer, make_triplet


@pytest.fixture
def shard(tmp_path: Path) -> Path:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, HEADER, [make_triplet(seed) for seed in range(4)])
    return path


@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_shard_is_refused_with_one_clear_line(shard: Path, fraction: float) -> None:
    content = shard.read_bytes()
    shard.write_bytes(content[: int(len(content) * fraction)])
    problems = verify_shard(shard)
    assert problems
    assert str(shard) in problems[0]
    assert "\n" not in problems[0]


def test_verify_notices_a_changed_value(shard: Path) -> None:
    with h5py.File(shard, "r+") as file:
        file["landmarks2d"][2, 10] += 1
    assert verify_shard(shard) == [
        "sample 'face/2': the checksum differs: the content has changed since it was written"
    ]


def test_verify_notices_values_outside_the_mask(shard: Path) -> None:
    with h5py.File(shard, "r+") as file:
        file["pncc_coded"][1, 0, 0] = 5
    assert any("pncc is not 0 outside the mask" in problem for problem in verify_shard(shard))


def changed_layer(triplet: Sample, name: str, change: Callable[[np.ndarray], np.ndarray]) -> Sample:
    return replace(triplet, layers={**triplet.layers, name: change(triplet.layers[name].copy())})


def set_to(place: object, value: object) -> Callable[[np.ndarray], np.ndarray]:
    def change(values: np.ndarray) -> np.ndarray:
        values[place] = value
        return values

    return change


@pytest.mark.parametrize(
    ("layer", "change", "message"),
    [
        ("pncc", set_to((8, 9), 0), "pncc is 0 within the mask, where no point of a face is"),
        ("pncc", set_to((8, 9), 130), r"pncc reaches 130\.0 mm, beyond the model's 120\.0 mm"),
        ("mask", set_to((8, 9), False), "pncc is not 0 outside the mask"),
        ("mask", set_to((8, 9), False), "depth is not 0 outside the mask"),
        ("mask", lambda mask: mask & False, "the mask is empty"),
        ("normals", set_to((8, 9), 0.9), "normals are not of unit length within the mask"),
        ("regions", set_to((8, 9), 0), "regions is background within the mask"),
        ("regions", set_to((8, 9), 4), "regions counts to 4, the header names 3"),
        ("seen_regions", set_to((8, 9), 4), "seen_regions counts to 4, the header names 3"),
        ("mask", set_to((8, 9), False), "seen is not 0 outside the mask"),
    ],
)
def test_layers_that_contradict_each_other_are_named(
    tmp_path: Path, layer: str, change: Callable[[np.ndarray], np.ndarray], message: str
) -> None:
    header, (first, second) = every_layer(2)
    write_shard(tmp_path / "shard-00000.h5", header, [first, second])
    assert verify_shard(tmp_path / "shard-00000.h5") == []
    write_shard(tmp_path / "shard-00000.h5", header, [first, changed_layer(second, layer, change)])
    problems = verify_shard(tmp_path / "shard-00000.h5")
    assert any(re.fullmatch(f"sample 'face/1': {message}", problem) for problem in problems), problems
    assert not any("checksum" in problem or "face/0" in problem for problem in problems)


def test_a_picture_of_another_size_than_its_layers_is_named(tmp_path: Path) -> None:
    larger = replace(make_triplet(0), image_bytes=make_triplet(0, 30).image_bytes)
    write_shard(tmp_path / "shard-00000.h5", HEADER, [larger, make_triplet(1)])
    (problem,) = verify_shard(tmp_path / "shard-00000.h5")
    assert problem.startswith("sample 'face/0': ")
    assert "sample 0: expected a picture like its layers, (24, 24), found one of (30, 30)" in problem


def test_pictures_that_do_not_decode_are_all_named(tmp_path: Path) -> None:
    """The first does not hide the second."""
    broken = [replace(make_triplet(seed), image_bytes=b"no picture") for seed in (0, 1)]
    write_shard(tmp_path / "shard-00000.h5", HEADER, [*broken, make_triplet(2)])
    problems = verify_shard(tmp_path / "shard-00000.h5")
    assert [problem[:15] for problem in problems] == ["sample 'face/0'", "sample 'face/1'"]
    assert "sample 1: expected a picture" in problems[1]


@pytest.mark.parametrize(
    ("name", "place", "value", "message"),
    [
        ("box_px", (2, 0), 3, "box_px .* is not the mask's bounding box"),
        ("offset_limit_mm", 2, 99, "offset_limit_mm is not the largest offset"),
        ("camera", (2, 0, 0), 5, "the checksum differs"),
        ("identity", (2, 0), np.nan, "identity is not finite"),
        ("image", (2, slice(500, 510)), 7, "expected a picture|the checksum differs"),
        ("image", (2, -1), 7, "expected zeros behind the picture, found others"),
        ("image_length", 2, -1, "image_length exceeds the rows of image"),
        ("checksum", 2, 0, "the checksum differs"),
        ("attributes", 2, b'{"yaw_deg": 9}', "the checksum differs"),
        ("attributes", 2, b'{"yaw_deg": null}', "got `null`"),
        ("attributes", 2, b"[1]", "Expected `object`, got `array`"),
        ("attributes", 2, b"{", "is damaged"),
    ],
)
def test_changed_columns_are_noticed(shard: Path, name: str, place: object, value: object, message: str) -> None:
    with h5py.File(shard, "r+") as file:
        file[name][place] = value
    problems = verify_shard(shard)
    assert any(re.search(message, problem) for problem in problems), problems


def change_header(path: Path, **changes: object) -> None:
    with h5py.File(path, "r+") as file:
        fields = json.loads(bytes(file.attrs["header"])) | changes
        file.attrs["header"] = fixed_text(json.dumps(fields))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"configuration": "no JSON"}, "the header's configuration: Expecting value"),
        ({"rejected": "{}"}, "the header's rejected: Expected `array`, got `object`"),
        ({"pncc_limit_mm": -1.0}, r"Expected `float` > 0.0 - at `\$.pncc_limit_mm`"),
        ({"layers": ["image", "teeth"]}, "the header names layers .*'teeth'"),
        ({"layers": "image"}, r"Expected `array`, got `str` - at `\$.layers`"),
        ({"model_name": 3}, r"Expected `str`, got `int` - at `\$.model_name`"),
        ({"surplus": 3}, "the header is not an object of model_name"),
    ],
)
def test_a_header_of_another_kind_is_named(shard: Path, changes: dict[str, object], message: str) -> None:
    change_header(shard, **changes)
    problems = verify_shard(shard)
    assert re.search(message, problems[0])


@pytest.mark.parametrize("name", ["sample_id", "camera", "box_px", "image_length", "image", "pncc_coded"])
@pytest.mark.parametrize("value", [np.zeros(3), np.zeros((4, 7, 7)), np.array([b"a"] * 3), None])
def test_datasets_of_another_kind_are_refused(shard: Path, name: str, value: np.ndarray | None) -> None:
    with h5py.File(shard, "r+") as file:
        del file[name]
        if value is not None:
            file[name] = value
    problems = verify_shard(shard)
    assert len(problems) == 1
    assert str(shard) in problems[0]


@pytest.mark.parametrize("name", ["sample_id", "camera", "pncc_coded", "surplus"])
def test_types_and_groups_in_place_of_datasets_are_refused(shard: Path, name: str) -> None:
    """Random damage makes one of the other: HDF5 tells them by a few bits."""
    for value in (np.dtype("i4"), None):
        with h5py.File(shard, "r+") as file:
            if name in file:
                del file[name]
            if value is None:
                file.create_group(name)
            else:
                file[name] = value
        assert verify_shard(shard) == [verify_shard(shard)[0]]
        assert f"{name} is no dataset" in verify_shard(shard)[0]


JOB = json.dumps({"n_faces": 7, "shard_size": 2})


def job_folder(folder: Path) -> Path:
    """Four shards of a job of seven faces."""
    for unit in range(4):
        triplets = [make_triplet(2 * unit + place) for place in range(2 if unit < 3 else 1)]
        write_shard(folder / f"shard-{unit:05d}.h5", replace(HEADER, configuration=JOB), triplets)
    return folder


def test_a_sound_folder_has_no_problems_and_is_counted(tmp_path: Path) -> None:
    seen: list[int] = []
    report = verify_folder(job_folder(tmp_path), lambda: seen.append(1))
    assert (report.problems, report.damaged) == ((), ())
    assert (report.n_samples, len(seen)) == (7, 4)


@pytest.mark.parametrize(
    ("units", "message"),
    [((1,), "1 missing: shard-00001.h5"), ((3,), "1 missing: shard-00003.h5"), ((0, 2, 3), "3 missing: shard-00000")],
)
def test_missing_shards_are_named(tmp_path: Path, units: tuple[int, ...], message: str) -> None:
    job_folder(tmp_path)
    for unit in units:
        (tmp_path / f"shard-{unit:05d}.h5").unlink()
    (problem,) = verify_folder(tmp_path).problems
    assert problem.startswith(message)


def test_ids_that_occur_twice_in_a_folder_are_named_with_both_shards(tmp_path: Path) -> None:
    job_folder(tmp_path)
    shutil.copy(tmp_path / "shard-00000.h5", tmp_path / "shard-00002.h5")
    report = verify_folder(tmp_path)
    assert report.problems == (
        "shard-00002.h5: id 'face/0' occurs twice, first in shard-00000.h5",
        "shard-00002.h5: id 'face/1' occurs twice, first in shard-00000.h5",
    )
    assert report.damaged == (tmp_path / "shard-00002.h5",)


def test_a_shard_of_another_job_is_named(tmp_path: Path) -> None:
    job_folder(tmp_path)
    write_shard(tmp_path / "shard-00003.h5", replace(HEADER, model_name="other"), [make_triplet(6)])
    report = verify_folder(tmp_path)
    assert report.problems == (
        "shard-00003.h5: other than in shard-00000.h5: model_name, configuration; of another job?",
    )
    assert report.damaged == ()


def test_a_folder_without_shards_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no shard-"):
        verify_folder(tmp_path)


def photograph(number: int, **changes: object) -> Sample:
    """A sample of a photograph whose face looks into the camera."""
    camera = posed_camera(12, 12, yaw_deg=10, scale=0.1)
    sample = replace(make_triplet(number), camera=camera, attributes={PICTURE: PictureKind.PHOTOGRAPH})
    return replace(sample, **changes)


def doubtful_photographs() -> list[Sample]:
    """One that is right, and one for each way to be wrong: as shards held them before annotations were checked."""
    turned = posed_camera(12, 12, yaw_deg=170, scale=0.1)
    tagged = with_orientation(encode_photograph(np.full((24, 24, 3), 90, np.uint8)), 6)
    return [
        photograph(0),
        photograph(1, camera=turned),
        photograph(2, identity=np.full(5, 16.0)),
        photograph(3, landmarks2d=np.full((68, 2), 30.0)),
        photograph(4, image_bytes=tagged),
        replace(photograph(5, camera=turned), attributes={PICTURE: PictureKind.SYNTHETIC}),
        replace(
            photograph(6, landmarks2d=np.full((68, 2), 30.0)),
            attributes={PICTURE: PictureKind.PHOTOGRAPH, JITTER_OF: "face"},
        ),
    ]


def test_ground_truth_that_cannot_be_true_is_found_in_intact_shards(tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, HEADER, doubtful_photographs())
    assert verify_shard(path) == []
    report = verify_folder(tmp_path)
    assert report.problems == report.damaged == ()
    expected = ("looks 170° away", "nobody has its coefficients", "100 % of the landmarks", "orientation tag 6")
    for number, (found, text) in enumerate(zip(report.doubtful, expected, strict=True), start=1):
        assert found.startswith(f"shard-00000.h5: sample 'face/{number}': ")
        assert text in found


def test_numbers_of_shards_are_not_counted_one_by_one(tmp_path: Path) -> None:
    folder = job_folder(tmp_path / "shards")
    (folder / "shard-00000.h5").rename(folder / "shard-999999999999.h5")
    (problem,) = [text for text in verify_folder(folder).problems if "missing" in text]
    assert re.match(r"99999999999\d missing: shard-00000\.h5", problem)
    change_header(folder / "shard-00001.h5", configuration='{"n_faces": 1000000000, "shard_size": 1}')
    assert any("missing" in text for text in verify_folder(folder).problems)


def test_landmarks_that_differ_in_number_are_refused(shard: Path) -> None:
    with h5py.File(shard, "r+") as file:
        values = file["visible"][:, :67]
        del file["visible"]
        file["visible"] = values
    assert "the numbers of landmarks differ" in verify_shard(shard)[0]


def test_pictures_of_4096_pixels_are_checked(tmp_path: Path) -> None:
    mask = np.zeros((4096, 4096), dtype=bool)
    mask[8:10, 4000:4090] = True
    large = replace(make_triplet(0), image_bytes=None, layers={"mask": mask})
    write_shard(tmp_path / "shard-00000.h5", replace(HEADER, layers=("mask", "landmarks")), [large])
    assert verify_shard(tmp_path / "shard-00000.h5") == []


def test_layers_that_are_too_large_for_their_file_are_not_unfolded(tmp_path: Path) -> None:
    large = replace(make_triplet(0), image_bytes=None, layers={"mask": np.zeros((8192, 8192), dtype=bool)})
    write_shard(tmp_path / "shard-00000.h5", replace(HEADER, layers=("mask", "landmarks")), [large])
    with pytest.raises(
        InputFileError, match=r"shard-00000\.h5: expected samples of at most 16 megapixels, .*8192 x 8192"
    ):
        verify_folder(tmp_path)
