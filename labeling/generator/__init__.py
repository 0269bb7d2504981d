"""The label generator: from confident detections to labels of every view."""
