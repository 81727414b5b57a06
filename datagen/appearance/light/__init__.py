"""Light: environments, lamps, shadows, and where ambient light does not reach."""
