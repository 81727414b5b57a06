from dataclasses import replace

import numpy as np
import pytest

from datagen.cli import main
from datagen.faces.sources import TableSource
from datagen.jobs.render_job import RenderJob
from datagen.samples.baked_jitter import JitterBake
from pix2face.face_files.coefficients import FaceCoefficients, load_coefficients, save_coefficients
from pix2face.files.images import encode_image
from pix2face.geometry.camera import Camera
from pix2face.geometry.landmarks import IBUG68, MIRROR_IBUG68
from pix2face.models.model_file import write_stored_model
from pix2face.models.morphable_model import builtin_model
from pix2face.models.rasterise import render_maps
from pix2face.shards.sample import JITTER_OF
from pix2face.shards.shard_checks import verify_shard
from pix2face.shards.shard_reader import ShardReader
from tests.model_files import stored_small_head

pytestmark = pytest.mark.xdist_group("baked jitter")  # the shards are rendered once

N_FACES, N_VARIANTS, SIZE_PX = 3, 4, 96


@pytest.fixture(scope="module")
def faces(tmp_path_factory):
    """A table of three faces, the first two with photographs (red where x is large, green where y is)."""
    folder = tmp_path_factory.mktemp("faces")
    assert main(["sample", "--n", str(N_FACES), "--size", "160", "--out", str(folder / "drawn.h5")]) == 0
    rows, columns = np.mgrid[:160, :160].astype(np.uint8)
    photograph = np.dstack([columns, rows, np.full_like(rows, 200)])
    (folder / "photograph.png").write_bytes(encode_image(photograph))
    table = load_coefficients(folder / "drawn.h5")
    named = FaceCoefficients(**{**vars(table), "image_paths": ("photograph.png", "photograph.png", "")})
    save_coefficients(named, folder / "faces.h5")
    return folder / "faces.h5"


@pytest.fixture(scope="module")
def shards(faces, tmp_path_factory):
    out = tmp_path_factory.mktemp("baked")
    assert render(faces, out) == 0
    return out


def render(faces, out, *more):
    arguments = ["render", "--coeffs", str(faces), "--out", str(out), "--jitter", str(N_VARIANTS), "--jitter-mirror"]
    return main([*arguments, "--jitter-size", str(SIZE_PX), "--workers", "1", "--shard-size", "2", *more])


def triplets(folder):
    for path in sorted(folder.glob("shard-*.h5")):
        assert verify_shard(path) == []
        reader = ShardReader(path)
        for index in range(len(reader)):
            sample = reader.read(index)
            yield sample, sample.image


@pytest.mark.gl
def test_each_face_becomes_its_variants(shards):
    found = [triplet.sample_id for triplet, _ in triplets(shards)]
    expected = [f"seed0/{face:07d}/jitter-{number}" for face in range(N_FACES) for number in range(N_VARIANTS)]
    assert found == expected


@pytest.mark.gl
def test_the_maps_of_a_variant_are_rendered_by_its_camera(shards):
    """The oracle, on what the shard says of the variant: coefficients and camera; mirrored ones included."""
    model, n_mirrored = builtin_model(), 0
    for triplet, image in triplets(shards):
        vertices = model.vertices(triplet.identity[None], triplet.expression[None])[0]
        expected = render_maps(model, vertices, triplet.camera, SIZE_PX, SIZE_PX)
        assert image.shape == (SIZE_PX, SIZE_PX, 3)
        assert (expected["mask"] != triplet.maps.mask).sum() < 10
        both = expected["mask"] & triplet.maps.mask
        assert np.quantile(np.abs(expected["pncc"] - triplet.maps.pncc)[both], 0.999) < 0.03
        np.testing.assert_allclose(triplet.landmarks2d, triplet.camera.project(triplet.landmarks3d), atol=1e-3)
        n_mirrored += triplet.attributes["jitter_mirrored"] == 1
    assert 2 < n_mirrored < N_FACES * N_VARIANTS - 2


@pytest.mark.gl
def test_photograph_and_landmarks_of_a_variant_belong_together(faces, shards):
    """The colours of the photograph say where each pixel comes from: the landmarks must come from there too."""
    model, table = builtin_model(), load_coefficients(faces)
    row_of = {name: row for row, name in enumerate(table.sample_ids)}
    n_checked = 0
    for triplet, image in triplets(shards):
        row = row_of[str(triplet.attributes[JITTER_OF])]
        if not table.image_paths[row]:
            continue
        vertices = model.vertices(table.identity[row][None], table.expression[row][None])[0]
        source = Camera(table.cameras[row]).project(vertices[model.landmarks[IBUG68]])
        mirrored = triplet.attributes["jitter_mirrored"] == 1
        order = np.arange(68) if not mirrored else np.array(MIRROR_IBUG68)
        inside = ((triplet.landmarks2d > 2) & (triplet.landmarks2d < SIZE_PX - 2)).all(axis=1)
        columns, lines = np.floor(triplet.landmarks2d[inside]).astype(int).T
        there = image[lines, columns].astype(float)
        # Colours were varied: compare directions, by the correlation of colour and place.
        places = source[order][inside]
        in_photograph = ((places > 2) & (places < 158)).all(axis=1)
        for channel in range(2):
            correlation = np.corrcoef(there[in_photograph, channel], places[in_photograph, channel])[0, 1]
            assert correlation > 0.97
        n_checked += 1
    assert n_checked == 2 * N_VARIANTS


@pytest.mark.gl
def test_more_variants_do_not_change_the_first(faces, shards, tmp_path):
    assert render(faces, tmp_path, "--jitter", str(N_VARIANTS + 1)) == 0
    before = {triplet.sample_id: image for triplet, image in triplets(shards)}
    after = {triplet.sample_id: image for triplet, image in triplets(tmp_path)}
    assert len(after) == N_FACES * (N_VARIANTS + 1)
    for name, image in before.items():
        np.testing.assert_array_equal(image, after[name])


@pytest.mark.gl
def test_a_folder_of_variants_is_completed_and_no_other_jitter_mixed_in(faces, shards, tmp_path, capsys):
    for path in shards.glob("shard-*.h5"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    last = sorted(tmp_path.glob("shard-*.h5"))[-1]
    content = last.read_bytes()
    last.unlink()
    assert render(faces, tmp_path) == 0
    assert last.read_bytes() == content
    assert render(faces, tmp_path, "--jitter", "2") == 2
    assert "jitter_n 4 -> 2" in capsys.readouterr().err


@pytest.mark.gl
def test_a_photograph_that_cannot_be_read_rejects_all_its_variants(faces, tmp_path):
    source = tmp_path / "faces"
    source.mkdir()
    for path in faces.parent.iterdir():
        (source / path.name).write_bytes(path.read_bytes())
    (source / "photograph.png").write_bytes(b"no picture")
    assert render(source / "faces.h5", tmp_path / "out") == 3
    assert len(list(triplets(tmp_path / "out"))) == N_VARIANTS
    assert len((tmp_path / "out" / "rejected.jsonl").read_text().splitlines()) == 2 * N_VARIANTS


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--jitter", "-1"], "--jitter: expected 0 to 1000"),
        (["--jitter-size", "0"], "--jitter-size: expected a side"),
        (["--jitter", "0", "--jitter-mirror"], "--jitter-mirror: expected --jitter N with them"),
        (["--jitter", "0", "--jitter-size", "99"], "found no variants to make"),
        (["--jitter-size", "99999"], "--jitter-size: expected a side of 1 to 16384 pixels, found 99999"),
    ],
)
def test_wrong_numbers_are_one_line(faces, tmp_path, capsys, more, message):
    assert render(faces, tmp_path, *more) == 2
    assert message in capsys.readouterr().err


def test_mirrored_variants_of_an_asymmetric_model_are_refused(tmp_path, capsys):
    write_stored_model(replace(stored_small_head(), symmetry=None), tmp_path / "lopsided.h5")
    table = tmp_path / "faces.h5"
    assert main(["sample", "--n", "2", "--out", str(table), "--model", str(tmp_path / "lopsided.h5")]) == 0
    assert render(table, tmp_path / "out", "--model", str(tmp_path / "lopsided.h5")) == 2
    assert "mirror images of each other" in capsys.readouterr().err


def test_what_becomes_of_a_sample_is_itself_where_nothing_is_baked(faces):
    source = TableSource(faces, builtin_model())
    job = RenderJob(faces, "builtin", 0, 2)
    assert job.sample_ids_of(source, 0) == list(source.sample_ids[:2])
    assert JitterBake().described() == {}
