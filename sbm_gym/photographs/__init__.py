"""Photographs as COCO would have them: canonical views of furniture and vehicles, to pre-train detectors on."""
