"""Folders of runs, made up."""

from pmopt.reporting.runs.run_folder import RunFolder
from pmopt.storage.checkpoint import CheckpointFolder


def make(folder, text, names, checkpoint=True):
    """Write a run whose files say by which text they are."""
    with RunFolder(folder, force=True) as run:
        run.open()
        if checkpoint:
            CheckpointFolder(run.place, text, "chunk", {}, {}).start()
        for name in names:
            run.write(name, text)
        run.close(text, {"units": {}})
