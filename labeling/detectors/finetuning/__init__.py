"""Training a 2-D detector on labels."""
