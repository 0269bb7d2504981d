"""Motion in recordings: of objects whose poses are known, and of their points."""
