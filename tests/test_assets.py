"""What the package ships is what its scripts made, is listed, and is small."""

import hashlib
from pathlib import Path

ROOT = Path(__file__).parents[1]
LISTED = dict(
    reversed(line.split("  ")) for line in (ROOT / "scripts" / "assets.sha256").read_text(encoding="utf-8").splitlines()
)
TO_DRAW_FROM = sorted(
    path
    for path in [*(ROOT / "datagen" / "assets").rglob("*"), ROOT / "pix2face" / "assets" / "builtin_model.h5"]
    if path.is_file()
)


def test_assets_are_those_that_the_scripts_made() -> None:
    found = {str(path.relative_to(ROOT)): hashlib.sha256(path.read_bytes()).hexdigest() for path in TO_DRAW_FROM}
    assert found == LISTED


def test_assets_are_small() -> None:
    assert sum(path.stat().st_size for path in TO_DRAW_FROM) < 25e6
    assert (ROOT / "pix2face" / "assets" / "checkpoint.safetensors").stat().st_size < 20e6
    assert (ROOT / "pix2face" / "assets" / "detector.safetensors").stat().st_size < 2e6


def test_the_card_is_that_of_the_packaged_network() -> None:
    weights = (ROOT / "pix2face" / "assets" / "checkpoint.safetensors").read_bytes()
    assert hashlib.sha256(weights).hexdigest() in (ROOT / "docs/measurements/packaged_network/card.md").read_text(
        encoding="utf-8"
    )


def test_assets_are_listed_with_origin_and_terms() -> None:
    text = (ROOT / "ASSETS.md").read_text(encoding="utf-8")
    for path in TO_DRAW_FROM:
        place = path.relative_to(ROOT)
        assert any(name in text for name in (f"`{place}`", f"`{place.name}`", f"`{place.parent}/*`")), place
