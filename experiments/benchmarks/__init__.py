"""Speed beside rivals."""
