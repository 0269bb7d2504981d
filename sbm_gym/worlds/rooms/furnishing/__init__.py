"""How each kind of room is furnished."""
