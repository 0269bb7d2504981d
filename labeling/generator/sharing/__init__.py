"""Labels shared by the episodes of a scene."""
