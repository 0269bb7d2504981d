"""A MuJoCo model as flat tables that both renderers read: triangles, textures, lights."""
