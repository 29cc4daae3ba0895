"""Sections and surfaces of sets of poses, as numbers."""
