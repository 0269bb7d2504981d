"""A trained policy: its network, its spaces, its files."""
