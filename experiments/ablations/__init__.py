"""One setting at a time: labels and rewards."""
