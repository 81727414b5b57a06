"""The card of a released network: what it is, its training data, and its errors, which come from reports."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pix2face.errors import InputFileError
from pix2face.files.json_text import JsonObject, read_json_file
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.networks import MASK_PLANE, SCALE_PLANE, SEEN_PLANE

ONNX_NAME = "network.onnx"
REPORT_FORMAT = "pix2face-evaluation"
LARGEST_BYTES = 64 << 20

INTENDED_USE = """Use the network to estimate dense landmarks, a camera and the coefficients of the morphable model from
photographs of faces, in research, in graphics, or to measure other systems. It was neither made nor tested for
identifying people or for judging anybody. Its output is an estimate of shape, which looks plausible even where it is
wrong."""

KNOWN_FAILURES = """Errors are larger for large poses than for frontal faces, and larger for the jaw than for the inner
face (see the tables, if there are any). Hard cases are faces cut off by the border of the photograph, silhouettes, hard
shadows, and hands or objects in front of the face."""

WRITE_ONNX = "`pix2face export --checkpoint {weights} --out {onnx}` writes the network as ONNX."

WITHOUT_THIS_PACKAGE = """These lines need only `pip install onnxruntime`:

```python
import onnxruntime
network = onnxruntime.InferenceSession("{onnx}")
planes = network.run(None, {{"image": pictures}})[0]
```

`pictures` is a float32 array of shape (n, 3, {size}, {size}): RGB crops of faces, each value divided by 255, minus 0.5.
The side of a crop is {crop_scale:g} times the longer side of the face's box, which is tight around its 68 landmarks.
Planes 0 to 2 are x, y, z of PNCC in units of {pncc:g} mm, and planes 3 to 5 those of the offset in units of {offset:g}
mm. {mask} `network.get_modelmeta().custom_metadata_map` contains these numbers."""

NOT_MEASURED = "No report was given. `train export --report report.json` adds the tables of a report of `evaluate`."


def model_card(header: CheckpointHeader, weights: Path, reports: Sequence[Path], onnx: str | None = None) -> str:
    """The card of a checkpoint in Markdown, with the figures of reports that ``evaluate`` wrote.

    Args:
        header: Of the checkpoint.
        weights: The checkpoint.
        reports: Files of reports.
        onnx: Name of the same network as ONNX, if there is one. Without it, the card says how to write it.

    Raises:
        InputFileError: A report cannot be read, or is not one.
    """
    configuration = json.loads(header.configuration)
    measured = [_measured(path) for path in reports]
    sections = {
        "What it is": _what_it_is(header, weights, "initial_sha256" in configuration),
        "Use": INTENDED_USE.replace("\n", " "),
        "Run it without this package": _without_this_package(header, weights.name, onnx),
        "Training data": _data(header, configuration),
        "Measured errors": "\n\n".join(measured) or NOT_MEASURED,
        "Known failures": KNOWN_FAILURES.replace("\n", " "),
        "Configuration": "\n".join(_rows(_flat(configuration), ("option", "value"))),
        "Terms": f"Training data: {header.licence}. Code: Apache-2.0.",
    }
    body = "\n\n".join(f"## {title}\n\n{text}" for title, text in sections.items())
    return f"# A dense face network for {header.model_name}\n\n{body}\n"


def _what_it_is(header: CheckpointHeader, weights: Path, is_continued: bool) -> str:
    masks = {0: "no mask", 1: "the face's mask", 2: "the face's mask, and where it is seen"}[
        int(header.planes > MASK_PLANE) + int(header.planes > SEEN_PLANE)
    ]
    sha256 = hashlib.sha256(weights.read_bytes()).hexdigest()
    facts = {
        "input": f"RGB crop of a face, {header.size_px} x {header.size_px} px",
        "output": f"PNCC and offset (mm, frame of the morphable model), {masks}"
        + (", the expected error of PNCC" if header.planes > SCALE_PLANE else "")
        + (f", {header.n_landmarks} landmarks with their expected errors" if header.n_landmarks else "")
        + (", a correction of fits to the maps" if header.n_corrected else ""),
        "architecture": f"{header.architecture}, filters {'-'.join(str(width) for width in header.widths)}",
        "morphable model": f"{header.model_name}, SHA-256 {header.model_sha256}",
        "scales": f"PNCC {header.pncc_scale_mm:g} mm, offset {header.offset_scale_mm:g} mm",
        "landmarks": ", ".join(f"{scheme}, chosen on its fits" for scheme in header.landmarks)
        or "those of the morphable model",
        "trained on": f"{header.samples:,} draws in {header.epoch} epochs"
        + (", from the weights of another training (`initial_sha256` below)" if is_continued else ""),
        "weights": f"{weights.name}, {weights.stat().st_size / 1e6:.1f} MB, SHA-256 {sha256}",
    }
    usage = "Loading the file runs no code. To try it, run `pix2face predict --checkpoint FILE photo.jpg`."
    return "\n".join(_rows(facts, ("", ""))) + f"\n\n{usage}"


def _without_this_package(header: CheckpointHeader, weights: str, onnx: str | None) -> str:
    to_write = "" if onnx else WRITE_ONNX.format(weights=weights, onnx=ONNX_NAME) + " "
    mask = f"A pixel shows the face where the length of PNCC exceeds {header.smallest_radius_mm / 2:.1f} mm."
    if header.planes > MASK_PLANE:
        mask = "A pixel shows the face where plane 6 is above 0."
    if header.planes > SEEN_PLANE:
        mask += " Where plane 7 is above 0, nothing hides the face."
    if header.planes > SCALE_PLANE:
        mask += " Plane 8 is the logarithm of the expected error of PNCC, in the same unit as PNCC."
    if header.n_landmarks:
        mask += (
            " The second output holds, for each landmark of the model, its x and y from the middle of the crop and the "
            "logarithm of the scale of its error, in units of the crop's side."
        )
    return to_write + WITHOUT_THIS_PACKAGE.format(
        onnx=onnx or ONNX_NAME,
        size=header.size_px,
        crop_scale=header.crop_scale,
        pncc=header.pncc_scale_mm,
        offset=header.offset_scale_mm,
        mask=mask,
    )


def _data(header: CheckpointHeader, configuration: Mapping[str, Any]) -> str:
    n_samples = configuration.get("samples", "an unknown number of")
    sha256 = configuration.get("samples_sha256", "unknown")
    facts = [
        f"{n_samples} samples of the morphable model {header.model_name} (hash of their ids and contents: {sha256})."
    ]
    match configuration.get("correction"):
        case {"fits": fits, "samples": samples, "samples_sha256": own}:
            facts.append(
                f"The last training, with the correction of fits, took {fits} draws of {samples} others (hash: {own})."
            )
    return " ".join([*facts, f"Their terms: {header.licence}."])


def _measured(path: Path) -> str:
    """The table of one report."""
    try:
        report = read_json_file(path, JsonObject, "a report that `evaluate` wrote (report.json)", LARGEST_BYTES)
        if report["format"] != REPORT_FORMAT:
            raise ValueError(f"format {report['format']!r}")
        benchmark = report["benchmark"]
        landmarks = report["subject"].get("landmarks", "not stated")
        rows = [row for row in report["table"] if row["method"] == report["method"]]
        lines = [line for row in rows for line in _errors_of(row)]
        by = [table for own in report.get("by", ()) for table in ("", *_errors_by(own))]
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputFileError(
            f"{path}: expected a report that `evaluate` wrote (report.json), found another file ({error})"
        ) from error
    heading = f"**{benchmark['title']}**, {report['n_evaluated']} images, normalised by {benchmark['normaliser']}"
    table = ["| points | images | mean | median | above the threshold |", "| --- | --- | --- | --- | --- |", *lines]
    return f"{heading}; threshold {benchmark['threshold']:.0%}; landmarks: {_cell(landmarks)}:\n\n" + "\n".join(
        [*table, *by]
    )


def _errors_of(row: Mapping[str, Any]) -> Iterator[str]:
    """Lines of a table: each group, then all images."""
    for name, errors in [*row["groups"].items(), ("all images", row["all_images"])]:
        yield f"| {row['points']} | {_cell(name.replace('|', ''))} | {_figures(errors)} |"
    if row["mean_of_groups"] is not None:
        yield f"| {row['points']} | mean of groups | {row['mean_of_groups']:.2%} | | |"


def _errors_by(own: Mapping[str, Any]) -> Iterator[str]:
    """A table of errors in bins of an attribute of renders, over 68 points."""
    yield f"| `{_cell(own['attribute'])}` | images | not found | mean | median | above the threshold | 95 % interval |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for row in own["bins"]:
        interval = "none" if row["interval"] is None else " to ".join(f"{end:.2%}" for end in row["interval"])
        errors = row["errors"]
        counts = f"{errors['n_images']} | {errors['n_failed']}"
        yield f"| {_cell(row['name'])} | {counts} | {_figures(errors)} | {interval} |"


def _figures(errors: Mapping[str, Any]) -> str:
    figures = (errors["mean"], errors["median"], errors["failure_rate"])
    return " | ".join("none" if value is None else f"{value:.2%}" for value in figures)


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def _rows(values: Mapping[str, Any], heading: tuple[str, str]) -> Iterator[str]:
    yield f"| {heading[0]} | {heading[1]} |"
    yield "| --- | --- |"
    for name, value in values.items():
        yield f"| {name} | {_cell(value)} |"


def _cell(value: object) -> str:
    """A text without characters that would end its cell."""
    return " ".join(str(value).replace("|", "/").split())
