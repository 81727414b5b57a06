"""Hands, masks and objects before the face."""
