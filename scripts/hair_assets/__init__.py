"""Parts of ``scripts.build_hair_assets``."""
