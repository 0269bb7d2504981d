"""Furniture and street things made from a seed: shapes, paints, and one module for each family of things."""
