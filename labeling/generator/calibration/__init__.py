"""Calibration of detectors: models of their confidences, fitted to ground truth of training episodes."""
