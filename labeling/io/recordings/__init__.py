"""Recordings as other tools write them: nerfstudio folders, TUM RGB-D, ScanNet exports."""
