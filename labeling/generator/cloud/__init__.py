"""All views of an episode as one voxelised point cloud; points in free space, outliers and the ground in it."""
