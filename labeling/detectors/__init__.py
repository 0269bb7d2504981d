"""Detectors by name, networks that can be trained, and what trains them (docs/detectors.md)."""
