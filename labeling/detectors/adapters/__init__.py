"""Detectors of others: ONNX files and Python functions."""
