"""Settings of the label generator and its presets."""
