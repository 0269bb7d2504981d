"""Renderers that draw a MuJoCo model as colour, depth and geom ids."""
