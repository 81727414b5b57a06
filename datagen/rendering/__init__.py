"""From a posed mesh to layers and pictures, with OpenGL."""
