"""Comparison of policies from the same starts: returns, objects seen, and quality of the labels of their views."""
