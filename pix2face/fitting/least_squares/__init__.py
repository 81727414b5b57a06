"""Linear and non-linear least squares."""
