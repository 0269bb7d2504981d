"""From points with probabilities to modal and amodal masks of views."""
