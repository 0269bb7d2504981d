"""The builtin library: furniture made from a seed."""
