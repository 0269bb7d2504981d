"""Recordings as other tools write them: nerfstudio folders, TUM RGB-D, ScanNet exports.

Each layout only lists its frames (``nerfstudio``, ``tum``, ``scannet``); choosing among them and reading their pictures
is the same for all (``frames``, ``pictures``).
"""
