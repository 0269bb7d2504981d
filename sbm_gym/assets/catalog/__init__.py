"""Furniture of Sweet Home 3D libraries."""
