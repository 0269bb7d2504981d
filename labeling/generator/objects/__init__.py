"""Which detections, moved into the cloud, are of one object."""
