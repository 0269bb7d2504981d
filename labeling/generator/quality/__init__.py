"""How good each label is, what is to be ignored, and how large objects are."""
