"""Backdrops: reproducible, turned with the light and not with the head, without a seam, from the user's folder."""

import json
import os
from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from datagen.appearance.backdrop.backdrop import Backdrop, backdrop_pixels, draw_backdrop
from datagen.appearance.backdrop.backdrop_config import HARD_BACKDROP, BackdropConfig
from datagen.appearance.backdrop.patterns import PATTERNS, draw_pattern
from datagen.appearance.backdrop.picture_folder import list_pictures, read_crop
from datagen.appearance.light.environments import environment, look_up, panorama_grid, panorama_view, picture_panorama
from datagen.appearance.light.light import draw_light
from datagen.appearance.light.light_config import LightConfig
from datagen.appearance.light.light_sources import Light, PanoramaLight
from datagen.appearance.photograph.lens import defocused, disc
from pix2face.errors import InputFileError, UsageError
from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    Pinhole,
    WeakPerspective,
    pinhole_camera,
    rotation_of_pose,
    weak_perspective_camera,
)

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def camera(yaw: float = 0, size: int = 64, focal: float = 3.0) -> Camera:
    rotation = rotation_of_pose(HeadPose(0, yaw, 0))
    return pinhole_camera(Pinhole(focal * size, np.full(2, size / 2), rotation, np.array([0.0, 0.0, 800.0])))


def light_of(seed: int) -> Light:
    return draw_light(np.random.default_rng(seed), LightConfig())


def drawn(seed: int, config: BackdropConfig | None = None) -> Backdrop:
    return draw_backdrop(np.random.default_rng(seed), config or BackdropConfig(), light_of(seed))


def turned(name: str, heading: float, tilt: float = 0.0) -> PanoramaLight:
    return PanoramaLight(name=name, heading_deg=heading, tilt_deg=tilt, roll_deg=0.0, colour_matrix=IDENTITY)


def write_pictures(folder: Path) -> list[str]:
    """Three pictures, each of one colour, one of them deeper down."""
    (folder / "deeper").mkdir(parents=True)
    names = ["a.png", "b.jpg", "deeper/c.PNG"]
    for name, colour in zip(names, ([255, 0, 0], [0, 255, 0], [0, 0, 255]), strict=True):
        path = folder / name
        cv2.imwrite(str(path), np.full((90, 120, 3), colour[::-1], np.uint8))
    (folder / "notes.txt").write_text("no picture")
    return names


@pytest.mark.parametrize("seed", range(40))
def test_backdrops_are_finite_light_of_the_size_asked_for(seed: int) -> None:
    backdrop = drawn(seed)
    pixels = backdrop_pixels(backdrop, camera(seed), 48, 64)
    assert pixels.shape == (48, 64, 3)
    assert pixels.dtype == np.float32
    assert np.isfinite(pixels).all()
    assert pixels.min() >= 0
    np.testing.assert_array_equal(pixels, backdrop_pixels(drawn(seed), camera(seed), 48, 64))


def test_backdrops_are_json_and_of_all_kinds() -> None:
    count: Counter[str] = Counter()
    for seed in range(500):
        backdrop = drawn(seed)
        stored = json.loads(json.dumps(asdict(backdrop)))
        assert stored["kind"] == backdrop.kind
        assert stored["n_people"] == len(stored["people"]) == backdrop.n_people
        count[backdrop.kind] += 1
    assert set(count) == {"environment", "other environment", "plain", *PATTERNS}
    assert 0.3 < count["environment"] / 500 < 0.55  # lamps alone have none


def test_people_are_few_and_small_and_change_nothing_else() -> None:
    several = [drawn(seed, HARD_BACKDROP) for seed in range(300)]
    assert 0.12 < np.mean([backdrop.n_people > 0 for backdrop in several]) < 0.28
    assert max(backdrop.n_people for backdrop in several) == 3
    assert all(person.scale < 0.7 for backdrop in several for person in backdrop.people)
    alone = [drawn(seed, replace(HARD_BACKDROP, people_share=0.0)) for seed in range(40)]
    for with_people, without in zip(several, alone, strict=False):
        assert replace(with_people, people=(), n_people=0) == without


@pytest.mark.parametrize("name", sorted(PATTERNS))
def test_every_pattern_shows_something_and_differs_by_seed(name: str) -> None:
    for height, width in ((64, 96), (17, 9)):
        pictures = [draw_pattern(name, seed, height, width) for seed in range(6)]
        assert all(picture.shape == (height, width, 3) and picture.dtype == np.uint8 for picture in pictures)
        assert len({picture.tobytes() for picture in pictures}) == 6
        np.testing.assert_array_equal(pictures[2], draw_pattern(name, 2, height, width))
    assert np.median([draw_pattern(name, seed, 64, 64).std() for seed in range(12)]) > 2


def test_the_head_turns_and_the_world_stays() -> None:
    backdrop = Backdrop(kind="environment", panoramas=(turned("venice", 30.0),))
    np.testing.assert_allclose(
        backdrop_pixels(backdrop, camera(0), 32, 32), backdrop_pixels(backdrop, camera(80), 32, 32), atol=1e-6
    )


def test_a_camera_that_looks_to_the_right_sees_what_was_there() -> None:
    """Two views that overlap: the right half of one is the left half of the other, where both are distant."""
    view = 40.0
    ahead = panorama_view((turned("venice", 0.0),), camera(), (64, 64), view)
    aside = panorama_view((turned("venice", view),), camera(), (64, 64), view)
    np.testing.assert_allclose(ahead[:, -1], aside[:, 0], rtol=0.35, atol=0.05)
    assert np.abs(ahead[:, -1] - aside[:, 0]).mean() < 0.3 * np.abs(ahead[:, 0] - aside[:, 0]).mean()


def test_the_brightest_lamp_of_the_light_is_seen_where_it_is() -> None:
    """The sun of an environment lies in the picture where its direction projects."""
    sun = environment("sky").lamps[0].direction
    heading = float(np.rad2deg(np.arctan2(sun[0], sun[2])))
    tilt = float(np.rad2deg(np.arcsin(-sun[1])))
    view = panorama_view((turned("sky", heading - 10, tilt),), camera(), (64, 64), 60.0)
    row, column = np.unravel_index(view.sum(axis=2).argmax(), view.shape[:2])
    assert abs((row + 0.5) / view.shape[0] - 0.5) < 0.08
    # To the right of the middle. Near the sun's height meridians come together, so it is less than 10 degrees.
    assert 0.5 < (column + 0.5) / view.shape[1] < 0.7


def test_panoramas_know_no_seam_and_texels_keep_their_colour() -> None:
    height, width = picture_panorama("hall").shape[:2]
    directions, _ = panorama_grid(height, width)
    np.testing.assert_allclose(
        look_up("hall", directions)[4:-4:7, ::13], picture_panorama("hall")[4:-4:7, ::13], rtol=0.05, atol=0.02
    )
    angles = np.pi + np.linspace(-0.02, 0.02, 41)  # straight behind, where columns begin and end
    behind = np.stack([np.sin(angles), np.zeros(41), np.cos(angles)], axis=1)[None]
    steps = np.abs(np.diff(look_up("hall", behind)[0], axis=0)).max()
    texels = np.abs(
        np.diff(np.roll(picture_panorama("hall"), 4, axis=1)[height // 2 - 1 : height // 2 + 1, :8], axis=1)
    )
    assert steps <= 1.05 * texels.max() + 1e-6  # between texels nothing jumps more than from one to the next


def test_the_field_of_view_is_the_cameras_unless_it_is_widened() -> None:
    panoramas = (turned("forest", 0.0),)
    near, far = (panorama_view(panoramas, camera(focal=focal), (64, 64), 0.0) for focal in (1.0, 6.0))
    assert near.std() > far.std()
    focal = 0.5 / np.tan(np.deg2rad(25))
    same = panorama_view(panoramas, camera(focal=focal), (64, 64), 0.0)
    np.testing.assert_allclose(same, panorama_view(panoramas, camera(), (64, 64), 50.0), rtol=1e-4, atol=1e-4)
    affine = weak_perspective_camera(WeakPerspective(0.4, np.diag([1.0, -1.0, -1.0]), np.full(2, 32.0)))
    assert panorama_view(panoramas, affine, (64, 64), 0.0).shape[2] == 3


def test_a_blur_out_of_focus_keeps_light_and_makes_discs() -> None:
    point = np.zeros((65, 65, 3), np.float32)
    point[32, 32] = 100
    np.testing.assert_array_equal(defocused(point, 0.3), point)
    for radius in (2.0, 6.0, 12.0):
        blurred = defocused(point, radius)
        assert abs(blurred.sum() / point.sum() - 1) < 0.05
        rows, columns, _ = np.nonzero(blurred > 0.3 * blurred.max())
        # Where the picture was made smaller for it, edges are as wide as its texels.
        reach = np.hypot(rows - 32, columns - 32).max()
        assert 0.8 * radius - 1 < reach < 1.2 * radius + radius / 3 + 1
    assert abs(disc(2.7).sum() - 1) < 1e-6


def test_pictures_of_a_folder_are_found_sorted_and_cut(tmp_path: Path) -> None:
    names = write_pictures(tmp_path)
    assert list_pictures(str(tmp_path)) == tuple(names)
    config = BackdropConfig(folder=str(tmp_path), folder_share=1.0)
    found = {drawn(seed, config).file for seed in range(30)}
    assert found == set(names)
    backdrop = drawn(3, config)
    assert backdrop.kind == "photograph"
    assert str(tmp_path) not in json.dumps(asdict(backdrop))
    pixels = backdrop_pixels(backdrop, camera(), 40, 56, folder=str(tmp_path))
    assert pixels.shape == (40, 56, 3)
    channel = names.index(backdrop.file)
    assert pixels.mean(axis=(0, 1)).argmax() == channel
    with pytest.raises(UsageError, match="folder"):
        backdrop_pixels(backdrop, camera(), 40, 56)


@pytest.mark.parametrize(("height", "width"), [(64, 64), (30, 200), (200, 30), (700, 900)])
@pytest.mark.parametrize("crop", [(0.0, 0.0, 1.0), (1.0, 1.0, 0.3), (0.5, 0.2, 0.01)])
def test_crops_have_the_size_asked_for(tmp_path: Path, height: int, width: int, crop: tuple) -> None:
    ramp = np.broadcast_to(np.linspace(0, 255, 400).astype(np.uint8)[None, :, None], (300, 400, 3))
    cv2.imwrite(str(tmp_path / "ramp.png"), ramp)
    found = read_crop(str(tmp_path), "ramp.png", crop, height, width)
    assert found.shape == (height, width, 3)
    # The left border of the crop is that of the picture, its right border likewise.
    if crop[0] == 1.0:
        assert found[:, -1].mean() > 240
    elif crop[0] == 0.0 and width >= height:
        assert found[:, 0].mean() < 15


def test_pictures_of_fractions_serve_as_others(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "grey.tiff"), np.full((64, 64), 0.5, np.float32))
    found = read_crop(str(tmp_path), "grey.tiff", (0.0, 0.0, 1.0), 8, 8)
    assert np.abs(found.astype(int) - 127).max() <= 1


def test_folders_and_files_that_cannot_be_used_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match=r"missing: expected a folder"):
        drawn(0, BackdropConfig(folder=str(tmp_path / "missing"), folder_share=1.0))
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputFileError, match=r"empty: expected pictures"):
        drawn(0, BackdropConfig(folder=str(tmp_path / "empty"), folder_share=1.0))
    broken = tmp_path / "broken"
    write_pictures(broken)
    (broken / "zz.jpg").write_bytes(b"no picture at all")
    with pytest.raises(InputFileError, match=r"zz\.jpg: expected a picture"):
        drawn(0, BackdropConfig(folder=str(broken), folder_share=1.0))


@pytest.mark.parametrize("side", [20, 400])  # read at an eighth of its size, and whole
@pytest.mark.parametrize(
    ("name", "flags"),
    [("half.png", []), ("half.jpg", []), ("half.jpg", [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])],
    ids=["png", "jpeg", "progressive jpeg"],
)
def test_a_file_that_breaks_off_is_named_when_it_is_read(
    name: str, flags: list[int], side: int, tmp_path: Path
) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (480, 480, 3)).astype(np.uint8)
    whole = cv2.imencode(Path(name).suffix, noise, flags)[1].tobytes()
    (tmp_path / name).write_bytes(whole)
    assert read_crop(str(tmp_path), name, (0.0, 0.0, 1.0), side, side).shape == (side, side, 3)
    (tmp_path / name).write_bytes(whole[: len(whole) // 2])
    assert list_pictures(str(tmp_path)) == (name,)
    with pytest.raises(InputFileError, match=rf"{name}: expected a picture for backdrops, found one that breaks off"):
        read_crop(str(tmp_path), name, (0.0, 0.0, 1.0), side, side)


def test_backdrops_that_are_no_files_or_too_large_are_named(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.jpg")
    with pytest.raises(InputFileError, match=r"pipe\.jpg: expected a picture, found a device.*take it out"):
        list_pictures(str(tmp_path))
    (tmp_path / "pipe.jpg").unlink()
    (tmp_path / "bomb.webp").write_bytes(b"P5\n32000 32000\n255\n")
    with pytest.raises(
        InputFileError, match=r"bomb.*megapixels, found a head that declares 32000 x 32000.*take it out"
    ):
        read_crop(str(tmp_path), "bomb.webp", (0.0, 0.0, 1.0), 20, 20)


def test_what_is_behind_fits_the_light() -> None:
    """A silhouette stands before something bright, a face at night not."""

    def brightness(kind: str) -> float:
        weights = {f"{each}_weight": float(each == kind) for each in ("soft", "directional", "studio")}
        weights |= {f"{each}_weight": float(each == kind) for each in ("backlit", "silhouette", "night")}
        found = []
        for seed in range(60):
            rng = np.random.default_rng(seed)
            light = draw_light(rng, replace(LightConfig(), **weights))
            backdrop = draw_backdrop(rng, replace(BackdropConfig(), plain_weight=0.0), light)
            found.append(np.median(backdrop_pixels(backdrop, camera(), 32, 32)) / light.illuminance)
        return float(np.median(found))

    assert brightness("silhouette") > 3
    assert brightness("silhouette") > 3 * brightness("soft")
    assert brightness("night") < 0.6


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({f"{kind}_weight": 0.0 for kind in ("same_environment", "other_environment", "pattern", "plain")}, "above 0"),
        ({"blur": (0.0, 0.1)}, "blur"),
        ({"widest_view_deg": 200.0}, "widest_view_deg"),
        ({"most_people": 9}, "most_people"),
    ],
)
def test_a_configuration_that_makes_no_sense_is_refused_by_name(change: dict[str, object], named: str) -> None:
    with pytest.raises(UsageError, match=named):
        drawn(0, replace(BackdropConfig(), **change))
