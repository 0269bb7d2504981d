"""Scenes: rooms to explore, what stands in them, and where one can stand."""
