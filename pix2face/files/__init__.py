"""Reading and writing files: HDF5, text, pictures."""
