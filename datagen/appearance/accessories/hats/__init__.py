"""Hats, headscarves and hoods."""
