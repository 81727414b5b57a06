"""Where the landmarks are on a model."""
