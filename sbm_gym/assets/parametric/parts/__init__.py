"""What parametric models are put together from."""
