"""The effects of lens, sensor, processing and file on a picture."""
