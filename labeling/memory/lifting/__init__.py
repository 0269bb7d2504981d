"""From views to voxels and back, without anything learnt: unprojection, stabilisation, alignment, projection."""
