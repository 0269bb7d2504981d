"""Detectors of 3-D boxes: frustum PointNet, the LDLS baseline, and how both are scored."""
