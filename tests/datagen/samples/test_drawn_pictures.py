"""Synthetic photographs, and what their layers say of what stands before the face."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from datagen.appearance.accessories.before_face.masks import draw_mask
from datagen.appearance.appearance import Appearance, draw_appearance
from datagen.appearance.appearance_config import DEFAULT, PLAIN, PRESETS
from datagen.appearance.backdrop.patterns import draw_background
from datagen.appearance.photograph.border import Border, beyond_border
from datagen.appearance.plain_appearance import develop, draw_plain_appearance
from datagen.appearance.scene import SCENE_REGIONS
from datagen.cli import main
from datagen.opengl.gl_context import GLContext
from datagen.random_streams import generator_for
from datagen.rendering.renderer import Renderer
from datagen.samples import drawn_pictures
from datagen.samples.sample_making import SampleMaker
from datagen.sampling.faces import sample_faces
from pix2face.errors import InputFileError, UsageError
from pix2face.evaluation.benchmarks.manifest import load_manifest
from pix2face.face_files.coefficients import Face, save_coefficients
from pix2face.files.images import encode_photograph
from pix2face.files.picture_head import orientation_tag
from pix2face.models.morphable_model import builtin_model
from pix2face.shards.layers import DEFAULT_LAYERS, LAYER_NAMES, SCENE_LAYERS
from pix2face.shards.sample import Sample
from pix2face.shards.sample_filter import AttributeExpression
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import ShardWriter
from tests.pix2face.files.test_images import with_orientation
from tests.synthetic_models import small_head_model

pytestmark = [pytest.mark.gl, pytest.mark.xdist_group("drawn pictures")]  # the pictures are drawn once

SIZE, SEED, N = 96, 5, 4
LAYERS = (*DEFAULT_LAYERS, "regions", *SCENE_LAYERS)
MOUTH = range(48, 68)
Change = Callable[[Appearance], Appearance]


@pytest.fixture(scope="module")
def faces(tmp_path_factory: pytest.TempPathFactory) -> list[Face]:
    tmp = tmp_path_factory.mktemp("faces")
    table = sample_faces(builtin_model(), N, 1, SIZE, PRESETS[DEFAULT].geometry)
    return [table.face(index, tmp) for index in range(N)]


@pytest.fixture(scope="module")
def maker(gl_session: GLContext) -> SampleMaker:
    return SampleMaker(builtin_model(), gl_session, SEED, LAYERS, PRESETS[DEFAULT])


@pytest.fixture(scope="module")
def made(maker: SampleMaker, faces: list[Face]) -> list[Sample]:
    return [maker.make(face) for face in faces]


@pytest.fixture
def with_change(monkeypatch: pytest.MonkeyPatch) -> Callable[[Change], None]:
    """Changes what is drawn for each sample."""
    original = draw_appearance

    def use(change: Change) -> None:
        def changed(*arguments: Any) -> Appearance:
            return change(original(*arguments))

        monkeypatch.setattr(drawn_pictures, "draw_appearance", changed)

    return use


def open_face(appearance: Appearance) -> Appearance:
    """With nothing before the face but hair, and the photograph's border far away."""
    nothing: dict[str, Any] = dict.fromkeys(("glasses", "beard", "headwear", "mask", "hand", "held", "thing"))
    return replace(
        appearance,
        accessories=replace(appearance.accessories, **nothing),
        photograph=replace(appearance.photograph, border=Border()),
    )


def masked(appearance: Appearance) -> Appearance:
    """With a surgical mask."""
    drawn = (draw_mask(np.random.default_rng(seed)) for seed in range(1000))
    mask = next(mask for mask in drawn if mask.kind == "surgical" and not mask.is_below_nose)
    bare = open_face(appearance)
    return replace(bare, accessories=replace(bare.accessories, mask=mask))


def label_of(name: str) -> int:
    return len(builtin_model().region_names) + 1 + SCENE_REGIONS.index(name)


def check_layers(sample: Sample) -> None:
    """What holds for every synthetic photograph."""
    n_model = len(builtin_model().region_names)
    mask, seen = sample.layers["mask"], sample.layers["seen"]
    regions, seen_regions = sample.layers["regions"], sample.layers["seen_regions"]
    assert not (seen & ~mask).any()
    assert not (seen & (seen_regions > n_model)).any()
    own = (seen_regions > 0) & (seen_regions <= n_model)
    np.testing.assert_array_equal(seen_regions[own], regions[own])
    np.testing.assert_array_equal(seen_regions[seen], regions[seen])
    assert seen_regions.max() <= n_model + len(SCENE_REGIONS)
    coverage = sample.layers["coverage"]
    assert coverage.min() >= 0
    assert coverage.max() <= 1
    assert (coverage[seen_regions > 0] > 0).all()
    assert sample.attributes["seen_share"] == pytest.approx(seen.sum() / mask.sum(), abs=1e-4)


def test_errors_can_be_told_apart_by_what_the_split_of_photographs_names(made: list[Sample]) -> None:
    for text in load_manifest("builtin-photographs").by:
        expression = AttributeExpression(text, "--by")
        for sample in made:
            value = expression.value(sample.sample_id, sample.attributes)
            assert isinstance(value, int | float), text


def test_what_is_seen_is_of_the_face_and_regions_are_the_heads_where_nothing_is_before_it(made: list[Sample]) -> None:
    for sample in made:
        check_layers(sample)
        assert sample.attributes["picture"] == "synthetic"
        assert sample.attributes["light.kind"]
        assert sample.image_bytes is not None
        assert sample.image.shape == (SIZE, SIZE, 3)
    assert any(sample.layers["seen"].sum() > 500 for sample in made)
    assert any((sample.layers["seen_regions"] == label_of("clothes")).any() for sample in made)


def test_the_same_seed_gives_the_same_bytes_and_another_another(
    maker: SampleMaker, faces: list[Face], made: list[Sample]
) -> None:
    for face, first in list(zip(faces, made, strict=True))[::-1]:  # in another order
        again = maker.make(face)
        assert again.image_bytes == first.image_bytes
        assert again.attributes == first.attributes
        for name, values in first.layers.items():
            np.testing.assert_array_equal(again.layers[name], values, err_msg=name)
        renamed = maker.make(replace(face, sample_id=f"{face.sample_id}-other"))
        assert renamed.image_bytes != first.image_bytes
        for name in ("pncc", "offset", "mask", "regions"):  # geometry is the face's alone
            np.testing.assert_array_equal(renamed.layers[name], first.layers[name], err_msg=name)


def test_a_mask_hides_mouth_and_chin(
    maker: SampleMaker, faces: list[Face], with_change: Callable[[Change], None]
) -> None:
    with_change(open_face)
    bare = [maker.make(face) for face in faces]
    with_change(masked)
    for face, before in zip(faces, bare, strict=True):
        sample = maker.make(face)
        check_layers(sample)
        hidden = sample.layers["mask"] & (sample.layers["seen_regions"] == label_of("mask"))
        assert hidden.sum() > 0.1 * sample.layers["mask"].sum()
        assert float(sample.attributes["seen_share"]) < min(1.0, float(before.attributes["seen_share"]))
        assert not (before.layers["seen_regions"] == label_of("mask")).any()
        np.testing.assert_array_equal(sample.layers["mask"], before.layers["mask"])


def test_landmarks_behind_a_mask_are_visible_but_not_seen(
    maker: SampleMaker, faces: list[Face], with_change: Callable[[Change], None]
) -> None:
    with_change(masked)
    n_hidden = 0
    for face in faces:
        sample = maker.make(face)
        seen = sample.seen_landmarks
        assert not (seen & ~sample.visible).any()
        for place in np.flatnonzero(sample.visible):
            column, row = np.floor(sample.landmarks2d[place]).astype(int)
            around = np.s_[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
            if sample.layers["mask"][around].any():  # else at the silhouette
                assert seen[place] == sample.layers["seen"][around].any()
            assert not (seen[place] and place in MOUTH)
        n_hidden += int((sample.visible & ~seen)[MOUTH].sum())
    assert n_hidden > 10


def test_nothing_is_seen_beyond_the_border(
    maker: SampleMaker, faces: list[Face], with_change: Callable[[Change], None]
) -> None:
    border = Border(left=0.5, bottom=0.3, filling="reflected")

    def narrowed(appearance: Appearance) -> Appearance:
        return replace(appearance, photograph=replace(appearance.photograph, border=border))

    with_change(narrowed)
    beyond = beyond_border(border, SIZE, SIZE)
    assert 0.6 < beyond.mean() < 0.7
    for face in faces:
        sample = maker.make(face)
        check_layers(sample)
        assert not sample.layers["seen"][beyond].any()
        assert not sample.layers["seen_regions"][beyond].any()
        assert not sample.layers["coverage"][beyond].any()
        assert sample.layers["mask"][beyond].any()  # maps go on there


def test_plain_is_a_head_painted_region_by_region(gl_session: GLContext, faces: list[Face]) -> None:
    model = builtin_model()
    renderer = Renderer(model, SIZE, SIZE, gl_session)
    plain = SampleMaker(model, gl_session, SEED, DEFAULT_LAYERS, PRESETS[PLAIN])
    for face in faces[:2]:
        sample = plain.make(face)
        rng = generator_for(SEED, face.sample_id)
        appearance = draw_plain_appearance(rng)
        background = draw_background(rng, SIZE, SIZE)
        vertices = model.vertices(face.identity[None], face.expression[None])[0]
        picture = renderer.render_image(vertices, face.camera, appearance, background)
        assert sample.image_bytes == encode_photograph(develop(picture, appearance))
        assert sample.attributes["picture"] == "plain"
        assert not any("." in name or name == "seen_share" for name in sample.attributes)
        assert not set(sample.layers) & set(SCENE_LAYERS)


@pytest.mark.parametrize("layer", SCENE_LAYERS)
def test_what_is_seen_is_refused_where_nothing_stands_before_faces(gl: GLContext, layer: str) -> None:
    with pytest.raises(
        UsageError, match=f"--layers {layer}: expected an appearance .*found plain; leave the layer out"
    ):
        SampleMaker(builtin_model(), gl, 0, ("image", layer), PRESETS[PLAIN])


@pytest.mark.parametrize("orientation", [1, 3, 6])
def test_photographs_are_stored_as_people_see_them(
    maker: SampleMaker, faces: list[Face], tmp_path: Path, orientation: int
) -> None:
    """Picture and maps have one frame, whether a program applies the orientation tag or not."""
    upright = np.zeros((SIZE, SIZE, 3), np.uint8)
    upright[: SIZE // 2] = 200
    stored = np.rot90(upright, {1: 0, 3: 2, 6: 1}[orientation]).copy()
    content = with_orientation(encode_photograph(stored), orientation)
    (tmp_path / "photograph.jpg").write_bytes(content)
    sample = maker.make(replace(faces[0], image_path=tmp_path / "photograph.jpg"))
    assert sample.image_bytes is not None
    assert (sample.image_bytes == content) == (orientation == 1)
    assert orientation_tag(sample.image_bytes) == 1
    assert np.abs(sample.image.astype(int) - upright).mean() < 4


def test_photographs_of_fractions_are_stored_as_pictures(maker: SampleMaker, faces: list[Face], tmp_path: Path) -> None:
    grey = np.linspace(0, 1, SIZE, dtype=np.float32)[:, None].repeat(SIZE, axis=1)
    assert cv2.imwrite(str(tmp_path / "photograph.tiff"), grey)
    sample = maker.make(replace(faces[0], image_path=tmp_path / "photograph.tiff"))
    assert np.abs(sample.image / 255 - grey[..., None]).max() < 0.02


def test_photographs_have_no_such_layer(maker: SampleMaker, faces: list[Face], tmp_path: Path) -> None:
    picture = np.full((SIZE, SIZE, 3), 90, np.uint8)
    (tmp_path / "photograph.jpg").write_bytes(encode_photograph(picture))
    sample = maker.make(replace(faces[0], image_path=tmp_path / "photograph.jpg"))
    assert sample.attributes["picture"] == "photograph"
    assert not set(sample.layers) & set(SCENE_LAYERS)
    with pytest.raises(InputFileError, match=r"expected the layers? .*seen"):
        ShardWriter(LAYERS).add(sample)


def test_other_models_have_no_such_appearance(gl: GLContext) -> None:
    with pytest.raises(
        UsageError, match=r"--appearance default: expected the built-in model, .*; give --appearance plain"
    ):
        SampleMaker(small_head_model(), gl, 0, DEFAULT_LAYERS, PRESETS[DEFAULT])


@pytest.mark.parametrize("preset", [DEFAULT, PLAIN])
def test_all_layers_are_those_that_the_appearance_has(gl: GLContext, tmp_path: Path, preset: str) -> None:
    del gl  # skips where there is none
    save_coefficients(sample_faces(builtin_model(), 2, 3, 64, PRESETS[preset].geometry), tmp_path / "faces.h5")
    options = ["--layers", "all", "--appearance", preset, "--workers", "1"]
    assert main(["render", "--coeffs", str(tmp_path / "faces.h5"), "--out", str(tmp_path / "out"), *options]) == 0
    expected = [name for name in LAYER_NAMES if preset == DEFAULT or name not in SCENE_LAYERS]
    names = builtin_model().region_names
    reader = ShardReader(tmp_path / "out" / "shard-00000.h5")
    assert list(reader.header.layers) == expected
    assert reader.header.region_names == ((*names, *SCENE_REGIONS) if preset == DEFAULT else names)
    assert len(reader) == 2
    for index in range(2):
        sample = reader.read(index)
        if preset == DEFAULT:
            check_layers(sample)
            assert sample.seen_landmarks.shape == sample.visible.shape
        else:
            with pytest.raises(UsageError, match="found no seen; render with --layers that name it"):
                _ = sample.seen_landmarks


def test_your_own_pictures_stand_behind_faces(
    gl: GLContext, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    del gl  # skips where there is none
    faces, pictures = tmp_path / "faces.h5", tmp_path / "pictures"
    save_coefficients(sample_faces(builtin_model(), 6, 3, 48, PRESETS[DEFAULT].geometry), faces)
    pictures.mkdir()

    def render(*options: str) -> int:
        command = ["render", "--coeffs", str(faces), "--out", str(tmp_path / "out"), "--workers", "1", *options]
        return main([*command, "--backgrounds", str(pictures)])

    assert render() == 2  # no picture in it
    assert "expected pictures" in capsys.readouterr().err
    (pictures / "wall.jpg").write_bytes(encode_photograph(np.full((60, 80, 3), (200, 30, 200), np.uint8)))
    assert render("--appearance", "plain") == 2
    assert "--backgrounds: expected synthetic photographs" in capsys.readouterr().err
    assert render() == 0
    reader = ShardReader(tmp_path / "out" / "shard-00000.h5")
    shown = [attributes.get("backdrop.file") for attributes in reader.attributes()]
    kinds = [attributes["backdrop.kind"] for attributes in reader.attributes()]
    assert "photograph" in kinds
    assert {file for file, kind in zip(shown, kinds, strict=True) if kind == "photograph"} <= {"wall.jpg", None}
