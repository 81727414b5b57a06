"""Readers of published models, one file each: they return a ``StoredModel`` in the project's frame and units."""
