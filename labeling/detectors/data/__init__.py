"""Annotated pictures and their augmentation."""
