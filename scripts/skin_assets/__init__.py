"""How the textures of the skin are packed and drawn."""
