"""What real sensors do to depth and poses, for recordings that should look as if one had taken them."""
