"""Makes meshes and textures of hair, for ``scripts/build_hair_assets.py``."""
