"""Errors by bin, intervals, pose."""
