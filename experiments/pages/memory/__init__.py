"""Pages about memories."""
