"""Single files: checked JSON, atomic writes, PLY."""
