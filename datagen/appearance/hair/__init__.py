"""Hair, brows and lashes."""
