"""Stages of experiments that are done once and kept."""
