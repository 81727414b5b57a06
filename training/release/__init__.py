"""Checkpoints for others, with their card."""
