"""The thesis' tables, and experiments in their manner."""
