"""Rasterising on the processor, without OpenGL: functions that Numba compiles."""
