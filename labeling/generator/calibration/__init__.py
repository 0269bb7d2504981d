"""What detections of each detector are worth, fitted to ground truth of training episodes."""
