"""The ``rays`` renderer: Embree ray casting and compiled shading, no OpenGL."""
