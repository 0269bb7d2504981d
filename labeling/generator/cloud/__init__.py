"""All views of an episode as one voxelised point cloud, without what cannot be there."""
