"""Pre-training of ``compact``."""
