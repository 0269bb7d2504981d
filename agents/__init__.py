"""Policies that move the camera, and the programs that run, train and compare them."""
