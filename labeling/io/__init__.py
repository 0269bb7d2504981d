"""Episodes and label sets on disk, and COCO files."""
