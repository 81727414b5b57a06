"""Backdrops of synthetic photographs."""
