"""3-D detection on a memory: heat maps from above, boxes, voxels that objects fill, training."""
