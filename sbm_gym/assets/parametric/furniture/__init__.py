"""Recipes of furniture."""
