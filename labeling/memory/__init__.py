"""Feature memories of scenes in 3-D, learnt by predicting views: GRNN and C-N3D (docs/neural-mapping.md)."""
