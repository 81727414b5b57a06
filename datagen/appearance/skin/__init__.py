"""Skin, eyes and the inside of the mouth."""
