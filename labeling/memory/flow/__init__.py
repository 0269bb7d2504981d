"""Flow on memories of two times, and what moves: correlation, network, pieces that are moved, training, boxes."""
