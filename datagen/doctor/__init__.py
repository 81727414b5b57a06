"""What OpenGL this machine has, and what to do where it does not work."""
