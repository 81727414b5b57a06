"""The morphable model: its file, its mesh, the reference rasteriser."""
