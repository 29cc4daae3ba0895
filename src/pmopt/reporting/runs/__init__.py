"""Runs: a folder with configuration, data, pictures and manifest each."""
