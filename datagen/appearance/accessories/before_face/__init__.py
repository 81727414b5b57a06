"""Hands, masks and objects in front of the face."""
