"""OpenGL without a display: contexts, devices, and what to do where it fails."""
