"""Pictures, and the values that they show."""
