"""What the processor draws itself, without OpenGL."""
