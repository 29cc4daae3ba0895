"""Bounds and claims that are proven, rounding included."""
