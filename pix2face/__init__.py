"""Dense 3D faces from photographs: the domain, its files, and inference.

``Pix2Face`` is what most programs need; it is loaded on first use, so that importing the package is quick.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pix2face.api import Pix2Face

__all__ = ["Pix2Face", "__version__"]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """Loads ``Pix2Face`` when it is asked for."""
    if name == "Pix2Face":
        from pix2face.api import Pix2Face

        return Pix2Face
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
