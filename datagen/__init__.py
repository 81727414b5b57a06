"""Ground truth: coefficients of a morphable model in, image / PNCC / offset triplets in sharded HDF5 out."""
