"""What lens, sensor, processing and file make of light."""
