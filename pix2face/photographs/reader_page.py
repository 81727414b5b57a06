"""An HTML file that runs the networks in a browser, on a photograph of its reader; nothing is loaded or uploaded.

It holds onnxruntime-web, the networks, and the program of ``scripts/reader`` (ASSETS.md says how it is built).
"""

import gzip
import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from string import Template
from typing import Any, final

from pix2face.detectors import centre_decoding, centre_detector
from pix2face.files.html_parts import base64_text, policy_hash, script_data
from pix2face.fitting.face_fit import ERROR_OF_FIT, MEAN_OF_SCALE
from pix2face.geometry.landmarks import IBUG68
from pix2face.inference.centre_files import OUTPUT_NAME as CELLS
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.onnx_networks import LANDMARKS_NAME
from pix2face.inference.onnx_networks import OUTPUT_NAME as MAPS
from pix2face.models.morphable_model import MorphableModel
from pix2face.networks import MASK_PLANE, SEEN_PLANE
from pix2face.networks.dimensions import CENTRE_MULTIPLE, CENTRE_STRIDE
from pix2face.photographs.refined_detection import PLAUSIBLE_ERROR, PLAUSIBLE_MM, PLAUSIBLE_OVERLAP

# Where no face is found, the detector looks again at a larger copy of the photograph.
SECOND_LOOK_PX = 640
# A landmark is hidden if the PNCC of no pixel is so near to its vertex.
SEEN_MM = 10.0


@final
@dataclass(frozen=True, eq=False)
class PageNetworks:
    """What a page runs."""

    parts: Sequence[bytes]  # ONNX, from a crop of a face to its maps: the network, or its two halves
    header: CheckpointHeader  # of the network
    detector: bytes  # ONNX
    model: MorphableModel  # the model of the network, whose landmarks are shown
    uses_own_landmarks: bool  # those of the network or the model, and not others that the user named


def reader_page(networks: PageNetworks) -> bytes:
    """The page, UTF-8."""
    script, style = _asset("reader.js").decode("ascii"), _asset("reader.css").decode()
    assert "</script" not in script.lower()
    blobs = {
        "runtime": _asset("onnxruntime.wasm.gz"),
        "notices": _asset("onnxruntime-notices.txt.gz"),
        "detector": gzip.compress(networks.detector, mtime=0),
    }
    for name, part in zip(("network", "decoder"), networks.parts, strict=False):  # a whole network has no decoder
        blobs[name] = gzip.compress(part, mtime=0)
    header = networks.header
    shown = {
        # Neither a connection nor another script: what is not named here is forbidden.
        "policy": f"default-src 'none'; script-src '{policy_hash(script)}' 'wasm-unsafe-eval'; "
        f"style-src '{policy_hash(style)}'; img-src data:",
        "style": style,
        "script": script,
        "settings": script_data(json.dumps(_settings(networks), allow_nan=False)),
        "files": "\n".join(
            f'<script type="text/plain" id="{name}">{base64_text(blob)}</script>' for name, blob in blobs.items()
        ),
        "about": escape(f"The network predicts maps of the model {header.model_name!r}."),
        "terms": escape(f"pix2face: Apache-2.0. Weights of the network: {header.licence}. onnxruntime-web: see below."),
        "runtime_licence": escape(_asset("LICENSE-onnxruntime.txt").decode()),
    }
    return Template(_asset("reader.html").decode()).substitute(shown).encode()


def _settings(networks: PageNetworks) -> dict[str, Any]:
    """What the program of the page must know of its networks."""
    header, model = networks.header, networks.model
    return {
        "frame": "pixels (x, y) of the upright photograph; the centre of the first pixel is (0.5, 0.5)",
        "detector": {
            "output": CELLS,
            "longest_sides_px": [centre_detector.LONGEST_SIDE_PX, SECOND_LOOK_PX],
            "largest_enlargement": centre_detector.LARGEST_ENLARGEMENT,
            "stride_px": CENTRE_STRIDE,
            "multiple": CENTRE_MULTIPLE,
            "grey": centre_detector.GREY,
            "least_score": centre_detector.LEAST_SCORE,
            "sure_score": centre_detector.SURE_SCORE,
            "same_face_overlap": centre_decoding.SAME_FACE_OVERLAP,
            "inside": centre_decoding.INSIDE,
        },
        "network": {
            "output": MAPS,
            "size_px": header.size_px,
            "crop_scale": header.crop_scale,
            "pncc_scale_mm": header.pncc_scale_mm,
            "offset_scale_mm": header.offset_scale_mm,
            "smallest_radius_mm": header.smallest_radius_mm,
            "planes": header.planes,
            "mask_plane": MASK_PLANE,
            "seen_plane": SEEN_PLANE,
            "plausible_mm": PLAUSIBLE_MM,
            "plausible_error": PLAUSIBLE_ERROR,
            "landmarks_output": LANDMARKS_NAME,
            "mixes_predicted_landmarks": networks.uses_own_landmarks
            and header.n_landmarks == len(model.landmarks[IBUG68]),
            "error_of_scale": ERROR_OF_FIT * MEAN_OF_SCALE,
            "plausible_overlap": PLAUSIBLE_OVERLAP,
            "seen_mm": SEEN_MM,
            "landmarks_mm": model.mean_landmarks(IBUG68).round(3).tolist(),
        },
    }


def _asset(name: str) -> bytes:
    return (files("pix2face") / "assets" / "reader" / name).read_bytes()
