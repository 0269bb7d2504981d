"""The ``gl`` renderer: MuJoCo's own OpenGL."""
