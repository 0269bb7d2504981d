"""The simulated detector, and what it is driven by."""
