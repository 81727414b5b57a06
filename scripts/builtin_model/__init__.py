"""How the built-in model is made from CC0 data; ``scripts/build_builtin_model.py`` runs it."""
