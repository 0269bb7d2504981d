"""Checking and refining the poses of an episode's views against their depths."""
