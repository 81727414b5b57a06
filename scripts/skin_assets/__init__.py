"""Makes the textures of the skin, for ``scripts/build_skin_assets.py``."""
