"""Furnished interiors: floor plans, shells, fittings."""
