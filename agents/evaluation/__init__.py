"""Policies measured against each other on the same starts: what they earn, see, and bring home as labels."""
