"""Which faces belong to a benchmark, and where they lie on disk."""
