"""Furniture models as arrays, whatever they were made from."""
