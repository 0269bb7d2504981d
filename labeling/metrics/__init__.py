"""Matching, average precision of masks and boxes, calibration error, bootstrap intervals."""
