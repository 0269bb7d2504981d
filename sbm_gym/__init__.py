"""MuJoCo worlds and the Gymnasium environment in which an agent moves to see better."""
