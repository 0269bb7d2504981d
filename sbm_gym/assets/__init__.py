"""Furniture and vehicle models: catalogues, conversion, credits."""
