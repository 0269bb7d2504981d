"""Detector and pseudo-labels compared with ground truth."""
