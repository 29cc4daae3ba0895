"""Threads, processes and machines: how work is spread."""
