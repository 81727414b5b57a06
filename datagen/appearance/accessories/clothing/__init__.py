"""Clothes, collars, neck and shoulders."""
