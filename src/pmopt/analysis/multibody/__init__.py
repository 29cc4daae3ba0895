"""Mechanisms as bodies and joints of a multibody engine."""
