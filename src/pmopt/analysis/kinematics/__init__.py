"""Inverse, forward and velocity kinematics at poses."""
