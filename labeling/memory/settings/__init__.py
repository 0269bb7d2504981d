"""Settings of memories and of their training. Loads no torch, so that commands answer at once."""
