"""Dense 3D faces from photographs: the domain, its files, and inference."""

__version__ = "0.1.0"
