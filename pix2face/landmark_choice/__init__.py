"""Which vertices of a model are its landmarks."""
