"""View atlases: stored depth, geom ids and detections of a grid of poses, looked up instead of rendered."""
