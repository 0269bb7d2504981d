"""Labels from moving: posed RGB-D views and a few confident detections in, pseudo-labels for every view out.

The ground floor: needs neither MuJoCo nor Gymnasium, so that it serves anybody's recordings.
"""
