"""Predicting views: samples of episodes, losses, training, scores, and plain reprojection to compare with."""
