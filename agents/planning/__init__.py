"""Where to go and look next: frontiers, paths, the view planner."""
