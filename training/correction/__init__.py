"""Trains what corrects the fits of a network: crops and fits to its maps in, nearer cameras and coefficients out."""
