"""Compiled worlds with an agent in them, and the settings of each kind of world."""
