"""Parts of models are index maps."""

from dataclasses import replace

import numpy as np
import pytest

from pix2face.errors import UsageError
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.model_crop import crop_model, without_regions
from pix2face.models.morphable_model import model_from_stored
from tests.model_files import stored_small_head


def test_a_head_without_neck_is_the_same_head() -> None:
    whole = stored_small_head()
    whole = replace(
        whole,
        albedo_mean=whole.mean / 200,
        albedo_basis=whole.identity_basis[:2],
        approximate_landmarks=np.array([3], np.int32),
    )
    part = without_regions(whole, "neck", "scalp")
    kept = part.source_vertices
    assert kept is not None
    assert 0 < len(kept) < len(whole.mean)
    np.testing.assert_array_equal(part.mean, whole.mean[kept])
    np.testing.assert_array_equal(part.expression_basis, whole.expression_basis[:, kept])
    assert part.albedo_mean is not None
    np.testing.assert_array_equal(part.albedo_mean, part.mean / 200)
    np.testing.assert_array_equal(part.mean[part.landmarks[IBUG68]], whole.mean[whole.landmarks[IBUG68]])
    np.testing.assert_array_equal(part.approximate_landmarks, [3])
    names = {part.region_names[i] for i in part.polygon_regions}
    assert names == {"skin", "lips", "eyes", "ears", "brows"}
    n_neck = sum(whole.region_names[i] in ("neck", "scalp") for i in whole.polygon_regions)
    assert len(part.polygons) == len(whole.polygons) - n_neck
    assert part.symmetry is not None
    assert (part.symmetry[part.symmetry] == np.arange(len(kept))).all()
    whole_face, part_face = (model_from_stored(model, "", 0) for model in (whole, part))
    coefficients = np.ones((1, 12)), np.ones((1, 6))
    np.testing.assert_allclose(
        part_face.vertices(*coefficients)[0], whole_face.vertices(*coefficients)[0][kept], atol=1e-5
    )


def test_corners_stay_the_same_points() -> None:
    whole = stored_small_head()
    chosen = np.arange(len(whole.polygons)) % 3 == 0
    part = crop_model(whole, chosen)
    np.testing.assert_array_equal(part.mean[part.polygons[:, :3]], whole.mean[whole.polygons[chosen][:, :3]])
    assert (part.polygons[:, 3] == -1).all()


def test_a_scheme_that_loses_a_point_is_dropped() -> None:
    whole = stored_small_head()
    part = crop_model(whole, whole.mean[whole.polygons[:, 0], 1] > 0)
    assert part.landmarks == {}
    assert part.approximate_landmarks is None


def test_a_part_of_a_part_still_knows_the_whole() -> None:
    whole = stored_small_head()
    part = without_regions(without_regions(whole, "scalp"), "neck")
    assert part.source_vertices is not None
    np.testing.assert_array_equal(part.mean, whole.mean[part.source_vertices])


def test_impossible_parts_are_refused() -> None:
    whole = stored_small_head()
    with pytest.raises(UsageError, match=r"expected regions of .*skin, .*found beard"):
        without_regions(whole, "beard")
    with pytest.raises(UsageError, match="at least one polygon"):
        without_regions(whole, *whole.region_names)
    with pytest.raises(UsageError, match="1 refinement steps"):
        without_regions(replace(whole, refinement_steps=1), "neck")
