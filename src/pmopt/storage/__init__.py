"""Files, folders of runs and checkpoints: written whole or not at all."""
