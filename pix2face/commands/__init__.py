"""The commands of ``pix2face``."""
