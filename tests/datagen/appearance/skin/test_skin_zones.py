"""Where on a head things are painted, and the textures' fit to it."""

from importlib.resources import files

import numpy as np
import pytest

from datagen.appearance.skin.skin_textures import ATLAS_UV, DETAILS_UV, LARGEST_RATIO, SKINS, skin_textures
from datagen.appearance.skin.uniforms import FOLDING
from datagen.appearance.skin.zones import LidMargins, head_paint
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.morphable_model import builtin_model

MODEL = builtin_model()
PAINT = head_paint(MODEL)


def _vertices(region: str):
    return np.unique(MODEL.triangles[MODEL.triangle_regions == MODEL.region_names.index(region)])


def _at(x: float, y: float, front: bool = True) -> int:
    outside = np.unique(MODEL.triangles[MODEL.triangle_regions <= MODEL.region_names.index("neck")])
    outside = outside[(MODEL.mean[outside, 2] > 0) == front]
    return int(outside[np.hypot(*(MODEL.mean[outside, :2] - [x, y]).T).argmin()])


def test_paint_is_within_0_and_1_and_the_same_on_both_sides():
    assert PAINT.min() >= 0
    assert PAINT.max() <= 1
    assert MODEL.symmetry is not None
    assert np.abs(PAINT - PAINT[MODEL.symmetry]).max() < 0.02


@pytest.mark.parametrize(
    ("channel", "inside", "outside"),
    [
        (0, (0, -50), (0, -65)),  # lips
        (4, (43, -10), (0, 80)),  # flush
        (5, (0, 70), (60, -20)),  # oil
        (6, (30, -65), (0, 60)),  # beard
        (6, (12, -28), (45, 5)),
        (7, (0, 130), (0, 75)),  # hair line
    ],
)
def test_zones_lie_where_they_do_on_people(channel, inside, outside):
    assert PAINT[_at(*inside), channel] > 0.55
    assert PAINT[_at(*outside), channel] < 0.25


def test_lips_fade_beyond_the_model_s_region():
    lips = _vertices("lips")
    assert PAINT[lips, 0].mean() > 0.85
    weights = PAINT[_vertices("skin"), 0]
    assert ((weights > 0.02) & (weights < 0.98)).sum() > 20


def test_lid_margins_follow_the_lids():
    margins = LidMargins(MODEL)
    assert [len(side) for side in margins.sides] == [len(margins.sides[0])] * 2
    frame, arch = margins.arches(MODEL.mean)
    upper, lower = arch[:, 0], arch[:, 2]
    landmarks = MODEL.mean[MODEL.landmarks[IBUG68]]
    assert frame[0, 1] + upper[0] == pytest.approx(landmarks[[43, 44], 1].mean(), abs=3)
    assert frame[0, 1] + lower[0] == pytest.approx(landmarks[[46, 47], 1].mean(), abs=2)
    assert frame[0] * [-1, 1, 1, -1] == pytest.approx(frame[1], abs=1e-3)
    shut = MODEL.vertices(np.zeros((1, MODEL.n_identity)), MODEL.named_expressions["eyeBlinkLeft"][None])[0]
    _, arch_shut = margins.arches(shut)
    assert arch_shut[0, 0] - arch_shut[0, 2] < 0.1 * (upper[0] - lower[0])
    assert arch_shut[1] == pytest.approx(arch[1], abs=0.5)


def test_textures_are_complete_and_small():
    textures = skin_textures()
    assert textures["skin_atlas"].pixels.shape[0] == len(SKINS)
    sizes = [(files("datagen") / "assets" / f"{name}.png").stat().st_size for name in textures]  # type: ignore[attr-defined]
    assert max(sizes) < 4e6
    assert sum(sizes) < 7e6


def _sampled(texture: str, uv_box, uv):
    """Texels at uv (v upward), nearest."""
    pixels = skin_textures()[texture].pixels
    _, height, width, _ = pixels.shape
    columns = (uv[:, 0] - uv_box[0]) / (uv_box[1] - uv_box[0]) * width
    rows = (uv_box[3] - uv[:, 1]) / (uv_box[3] - uv_box[2]) * height
    return pixels[:, np.clip(rows.astype(int), 0, height - 1), np.clip(columns.astype(int), 0, width - 1)]


def _uv_of(is_wanted):
    assert MODEL.uv is not None
    assert MODEL.uv_triangles is not None
    return MODEL.uv[MODEL.uv_triangles[is_wanted]].mean(axis=1)


def _middles(region: str):
    return MODEL.triangle_regions == MODEL.region_names.index(region), MODEL.mean[MODEL.triangles].mean(axis=1)


@pytest.mark.parametrize("skin", range(len(SKINS)))
def test_the_skins_lips_lie_on_the_model_s_lips(skin):
    is_lips, middle = _middles("lips")
    is_skin, _ = _middles("skin")
    around = is_skin & (np.hypot(middle[:, 0], middle[:, 1] + 65) < 12) & (middle[:, 2] > 60)
    ratio = [
        LARGEST_RATIO * np.square(_sampled("skin_atlas", ATLAS_UV, _uv_of(wanted))[skin] / 255.0).mean(axis=0)
        for wanted in (is_lips & (middle[:, 2] > 102), around)
    ]
    redness = [each[0] / each[1] for each in ratio]
    contrast = np.abs(np.log(ratio[0] / ratio[1])).max()
    is_painted = contrast > 0.05 if "african" in SKINS[skin] else redness[0] > 1.05 * redness[1]
    assert is_painted, (SKINS[skin], redness, contrast)
    # Each is divided by its own mean colour, so that melanin alone decides the tone.
    assert ratio[1] == pytest.approx([1, 1, 1], abs=0.2)


def test_painted_brows_lie_over_the_brow_landmarks_and_wrinkles_beside_the_nose():
    _, middle = _middles("skin")
    is_front = np.isin(MODEL.triangle_regions, [MODEL.region_names.index(name) for name in ("skin", "brows")])
    details = _sampled("skin_details", DETAILS_UV, _uv_of(is_front))[0] / 255.0
    place = middle[is_front]
    brow = details[:, 3] > 0.3
    landmarks = MODEL.mean[MODEL.landmarks[IBUG68]][17:27]
    distance = np.linalg.norm(place[brow][:, None] - landmarks, axis=2).min(axis=1)
    assert brow.sum() > 50
    assert np.percentile(distance, 95) < 11
    fold = (details[:, 2] > 0.5) & (place[:, 1] < -10) & (place[:, 1] > -23)
    assert fold.sum() > 20
    assert (np.abs(place[fold, 0]) > 13).mean() > 0.95


def test_the_expressions_that_fold_skin_are_the_model_s():
    for name in {name for group in FOLDING for name in group}:
        assert name in MODEL.named_expressions or {f"{name}Left", f"{name}Right"} <= MODEL.named_expressions.keys()
