"""Beards and their texture."""
