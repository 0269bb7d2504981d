"""Things that move while the robot does: routes, and who waits for whom."""
