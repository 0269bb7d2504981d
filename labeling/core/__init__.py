"""What everything else speaks of, as plain arrays: views, masks, boxes, cameras. Touches no file."""
