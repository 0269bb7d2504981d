"""Networks with a memory: GRNN, C-N3D, the 2-D baseline, and their parts."""
