"""Glasses: shapes, fit and choice."""
