"""Worlds compiled and ready for an agent, and what differs between kinds of worlds."""
