"""The manifests are complete and name what the benchmarks are known to hold."""

from dataclasses import replace

import pytest

from pix2face.errors import UsageError
from pix2face.evaluation.benchmarks.manifest import SPLITS, load_manifest


@pytest.mark.parametrize(
    ("split", "n_samples", "normaliser", "threshold"),
    [
        ("ibug", 135, "outer-eye", 0.08),
        ("300w-common", 554, "outer-eye", 0.08),
        ("300w-full", 689, "outer-eye", 0.08),
        ("aflw2000-3d", 2000, "box-sqrt", 0.10),
        ("aflw2000-3d-dev", 400, "box-sqrt", 0.10),
        ("aflw2000-3d-rest", 1600, "box-sqrt", 0.10),
        ("builtin-heldout", 100, "box-sqrt", 0.10),
        ("builtin-photographs", 600, "box-sqrt", 0.10),
        ("300vw", 64, "outer-eye", 0.08),
        ("menpo3d-tracking", 30, "outer-eye", 0.08),
    ],
)
def test_every_split_says_what_it_is(split, n_samples, normaliser, threshold):
    manifest = load_manifest(split)
    assert (manifest.split, manifest.n_samples) == (split, n_samples)
    assert (manifest.normaliser, manifest.threshold) == (normaliser, threshold)
    assert manifest.licence
    assert manifest.obtain in manifest.how_to_get_it
    assert manifest.layout in manifest.how_to_get_it
    for part in manifest.parts:
        assert len(set(part.image_names)) == len(part.image_names)


def test_full_is_common_and_ibug():
    full, common, ibug = (load_manifest(split) for split in ("300w-full", "300w-common", "ibug"))
    names = {part.name: part.image_names for part in full.parts}
    assert names == {part.name: part.image_names for part in (*common.parts, *ibug.parts)}


def test_two_parts_of_aflw_are_the_whole_and_measured_alike():
    whole, dev, rest = (load_manifest(f"aflw2000-3d{part}") for part in ("", "-dev", "-rest"))
    (all_names,), (chosen_by,), (others,) = ([part.image_names for part in own.parts] for own in (whole, dev, rest))
    assert sorted((*chosen_by, *others)) == sorted(all_names)
    same = {"split": "", "title": "", "parts": (), "n_samples": 0}
    assert replace(dev, **same) == replace(rest, **same) == replace(whole, **same)


def test_names_are_those_of_the_benchmarks(shared_dir):
    data = shared_dir / "data"
    lists = {
        "ibug": data / "300w" / "names" / "ibug.txt",
        "helen": data / "300w" / "names" / "helen_testset.txt",
        "lfpw": data / "300w" / "names" / "lfpw_testset.txt",
    }
    for part in load_manifest("300w-full").parts:
        assert list(part.image_names) == lists[part.name].read_text().split()
    (aflw,) = load_manifest("aflw2000-3d").parts
    assert [name.removesuffix(".jpg") for name in aflw.image_names] == (
        data / "aflw2000_3d" / "names.txt"
    ).read_text().split()


def test_unknown_split_lists_the_known_ones():
    with pytest.raises(UsageError, match=r"ibug.*found 'menpo'"):
        load_manifest("menpo")
    assert "ibug" in SPLITS


def test_the_clips_of_300vw_are_sixty_four_in_three_scenarios():
    *scenarios, rest = load_manifest("300vw").parts
    assert [len(part.clips) for part in scenarios] == [31, 19, 14]
    assert len({clip for part in scenarios for clip in part.clips}) == 64
    assert (rest.all_others, rest.clips) == (True, ())


def test_menpos_indices_are_every_second_jaw_point_and_all_inner_ones():
    indices = load_manifest("menpo3d-tracking").landmark_indices
    assert indices[:17] == tuple(range(0, 33, 2))
    assert indices[17:] == tuple(range(33, 84))


def test_another_truth_changes_word_and_sentence_and_no_other_is_known():
    original = load_manifest("aflw2000-3d")
    reannotated = original.with_truth("reannotated")
    assert (original.truth, reannotated.truth) == ("original", "reannotated")
    assert "Bulat" in reannotated.ground_truth
    assert original.with_truth("original") is original
    with pytest.raises(UsageError, match="aflw2000-3d: expected original or reannotated as --truth, found mine"):
        original.with_truth("mine")
    with pytest.raises(UsageError, match="ibug: expected hand-marked"):
        load_manifest("ibug").with_truth("reannotated")
