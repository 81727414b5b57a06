"""Makes the built-in model from CC0 data, for ``scripts/build_builtin_model.py``."""
