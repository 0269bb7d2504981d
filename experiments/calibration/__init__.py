"""Samples that label quality is fitted to."""
