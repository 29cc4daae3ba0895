"""Trajectories, and the rates and efforts along them."""
