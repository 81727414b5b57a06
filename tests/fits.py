"""Options of fits that tests and benchmarks share."""

from typing import Any

from pix2face.fitting.fit_options import FitOptions


def paper_fit(**changes: Any) -> FitOptions:
    """The paper's way: by PNCC and offset alone, not held to the silhouette; lambda is estimated unless given."""
    return FitOptions(**{"regularisation": "estimate", "silhouette": False} | changes)
