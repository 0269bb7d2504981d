"""How ``compact`` came about."""
