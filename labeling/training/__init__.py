"""What every training has in common: the loop, learning-rate schedule, checkpoints, files of a run."""
