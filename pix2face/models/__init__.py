"""The morphable model: its file, its mesh, the reference rasteriser."""

# Names the model that comes with the package, where a model file can be named too.
BUILTIN_MODEL = "builtin"
