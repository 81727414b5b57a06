"""Hats, scarves and what else covers the hair."""
