"""Clothes, collars and the body beneath."""
