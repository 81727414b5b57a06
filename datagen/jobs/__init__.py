"""The job: coefficients in, shards out, over many workers, and nothing lost."""
