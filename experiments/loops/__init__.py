"""Loops in which a detector that was taught by labels guides the robot to the views that further labels are made of."""
