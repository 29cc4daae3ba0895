"""Freedoms and constraints of a mechanism, from its joints."""
