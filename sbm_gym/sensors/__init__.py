"""Noise models of depth sensors and pose tracking, for recordings as a real robot would have taken them."""
