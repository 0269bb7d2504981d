"""Detectors of others: ONNX files, Python functions, masks for detectors that only give boxes."""
