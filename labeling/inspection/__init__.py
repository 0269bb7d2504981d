"""What can be wrong with a label set, pictures of it, and a viewer."""
