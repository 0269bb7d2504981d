"""From seeds of detections to objects: association across views and posteriors of categories."""
