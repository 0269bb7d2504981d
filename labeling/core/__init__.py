"""Data types that all folders share, as plain arrays: views, masks, boxes, cameras. Touches no file."""
