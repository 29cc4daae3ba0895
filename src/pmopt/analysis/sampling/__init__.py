"""Sampling: designs of settings, the compiled kernel at points, sums over points, estimates."""
