"""From a face to a sample: maps, picture, attributes."""
