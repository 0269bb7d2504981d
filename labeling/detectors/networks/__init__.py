"""Mask R-CNN and its parts, and networks as detectors."""
