"""Networks from a picture of a face to its maps, one architecture a file; ``architectures`` knows them by name."""
