"""What is in a folder is replaced as one whole or not at all, also where a process is killed.

The new files are complete in a folder within the folder before anything is touched. A journal then
says which names go and which come; the old ones are moved aside, the new ones to their places, and
the journal is removed. What fails on the way is undone. Where the process died, the next command on
the folder finds the journal and ends the work. From the journal and from what lies where, it is
always known which steps are left: each one renames a file or folder.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from pmopt.errors import InputError, PmoptError
from pmopt.inputs.reading import read_json
from pmopt.storage.files import remove_leftovers, unwritable, write_atomic

#: Where new files are until they are all there, and where old ones are until the new are in place.
NEXT, LAST = ".pmopt-next", ".pmopt-last"
JOURNAL = ".pmopt-swap"


def swap(folder: Path, old: Iterable[str], new: Sequence[str]) -> None:
    """Replace what a folder holds under the old names by the new names from within ``NEXT``.

    Parameters
    ----------
    folder : Path
        Locked by the caller.
    old : iterable of str
        Names in the folder, with those of ``new`` that are there already; the last of ``new``
        goes first. What is not there is no harm.
    new : sequence of str
        Names in ``NEXT``, in the order in which they come.

    Raises
    ------
    PmoptError
        When a file or folder cannot be moved; the folder is then as it was.
    """
    there = [name for name in dict.fromkeys([*reversed(new), *old]) if _is(folder / name)]
    try:
        write_atomic(folder / JOURNAL, json.dumps({"old": there, "new": list(new)}))
        _complete(folder, there, new)
    except BaseException as error:  # an interruption, too
        try:
            _undo(folder, there, new)
        except OSError as again:
            raise PmoptError(
                f"{unwritable(folder, again)}; the next command on it ends the replacement"
            ) from error
        if isinstance(error, OSError):
            raise unwritable(Path(error.filename or folder), error) from error
        raise
    clear(folder / LAST)
    clear(folder / NEXT)


def recover(folder: Path) -> None:
    """End the replacement at which a process was killed: complete it, or undo what cannot be.

    Parameters
    ----------
    folder : Path
        Locked by the caller.

    Raises
    ------
    PmoptError
        When neither is possible.
    """
    journal = folder / JOURNAL
    if _is(journal):
        old, new = _read(journal)
        try:
            _complete(folder, old, new)
        except OSError:
            try:
                _undo(folder, old, new)
            except OSError as error:
                raise unwritable(folder, error) from error
    clear(folder / LAST)
    with contextlib.suppress(OSError):
        remove_leftovers(folder)
    with contextlib.suppress(OSError):  # there is none, or a run in it
        (folder / NEXT).rmdir()


def is_unfinished(folder: Path) -> bool:
    """Return whether a process was killed, or is at work, in the middle of a replacement."""
    return _is(folder / JOURNAL)


def clear(folder: Path) -> None:
    """Remove a folder of this module with all that is in it, as far as possible."""
    if folder.is_symlink():
        return
    shutil.rmtree(folder, ignore_errors=True)


def _is(path: Path) -> bool:
    return os.path.lexists(path)


def _read(journal: Path) -> tuple[list[str], list[str]]:
    try:
        document = read_json(journal)
        old, new = list(document["old"]), list(document["new"])
        for name in [*old, *new]:
            if Path(name).name != name or name in (NEXT, LAST, JOURNAL):
                raise ValueError
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(
            f"{journal}: is not a journal of pmopt; with it the folder's content is not known"
        ) from None
    return old, new


def _complete(folder: Path, old: Sequence[str], new: Sequence[str]) -> None:
    """Finish the moves, and remove the journal."""
    ahead, aside = folder / NEXT, folder / LAST
    aside.mkdir(exist_ok=True)
    for name in old:
        arrived = name in new and not _is(ahead / name)
        if not arrived and _is(folder / name) and not _is(aside / name):
            os.rename(folder / name, aside / name)
    for name in new:
        if _is(ahead / name):
            os.rename(ahead / name, folder / name)
    (folder / JOURNAL).unlink(missing_ok=True)


def _undo(folder: Path, old: Sequence[str], new: Sequence[str]) -> None:
    """Move everything back, and forget the journal."""
    ahead, aside = folder / NEXT, folder / LAST
    for name in reversed(new):
        if not _is(ahead / name) and _is(folder / name) and (name not in old or _is(aside / name)):
            os.rename(folder / name, ahead / name)
    for name in reversed(old):
        if _is(aside / name):
            os.rename(aside / name, folder / name)
    with contextlib.suppress(FileNotFoundError):
        (folder / JOURNAL).unlink()
    clear(aside)
