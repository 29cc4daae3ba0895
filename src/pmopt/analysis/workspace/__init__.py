"""Sampling the poses in reach: volume, index, shape, positions."""
