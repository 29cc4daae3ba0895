"""Pictures drawn one by one, after the numbers: one that fails costs neither others nor a result.

What fails is no mistake of the run: matplotlib may be missing or damaged, memory may be short, a
setting of the machine may be odd.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from pmopt.errors import PmoptError

if TYPE_CHECKING:
    from pmopt.analysis.sampling.evaluator import Notify
    from pmopt.reporting.runs.run_folder import RunFolder

#: Under which the reason stands where not even the names of the pictures are known.
ALL = "all pictures"
#: Longest reason, in characters.
_LONGEST = 200


class Gallery(dict[str, bytes]):
    """Pictures by file name.

    Attributes
    ----------
    missing : dict of str to str
        Why a picture could not be drawn, by file name.
    """

    def __init__(self) -> None:
        super().__init__()
        self.missing: dict[str, str] = {}

    def add(self, name: str, draw: Callable[[], bytes]) -> None:
        """Draw a picture, or keep why it cannot be drawn."""
        try:
            self[name] = draw()
        except Exception as error:
            self.missing[name] = reason(error)

    def add_all(self, name: str, draw: Callable[[], Mapping[str, bytes]]) -> None:
        """Draw pictures that stand together, under ``name`` where they cannot be drawn."""
        try:
            drawn = draw()
        except Exception as error:
            self.missing[name] = reason(error)
        else:
            self.update(drawn)
            self.missing |= getattr(drawn, "missing", {})


def lines_of(missing: Mapping[str, str]) -> list[str]:
    """Return a line for each reason, with all pictures that it keeps away."""
    found: dict[str, list[str]] = {}
    for name, why in missing.items():
        found.setdefault(why, []).append(name)
    return [f"{', '.join(names)}: not drawn: {why}" for why, names in found.items()]


def missing_lines(manifest: Mapping[str, Any] | None) -> list[str]:
    """Return the lines of a run's manifest; none where there is no manifest."""
    missing = (manifest or {}).get("missing_pictures")
    return lines_of(missing) if isinstance(missing, dict) else []


def reason(error: Exception) -> str:
    """Return why something could not be drawn, as one line."""
    if isinstance(error, PmoptError):
        return str(error)
    kind = "out of memory" if isinstance(error, MemoryError) else type(error).__name__
    text = " ".join(str(error).split())
    text = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    return f"{kind}: {text}" if text else kind


@contextmanager
def wanted(name: str) -> Iterator[None]:
    """Draw a picture that is the very result: what fails is an error, in one line.

    Raises
    ------
    PmoptError
    """
    try:
        yield
    except PmoptError:
        raise
    except Exception as error:
        raise PmoptError(lines_of({name: reason(error)})[0]) from error


def write_pictures(
    folder: RunFolder, draw: Callable[[], Mapping[str, bytes]], notify: Notify | None = None
) -> dict[str, Any]:
    """Draw the pictures of a run whose data files are written, and write them beside.

    Parameters
    ----------
    folder : RunFolder
    draw : callable
        Returns the pictures by file name.
    notify : callable, optional
        Receives a line for what could not be drawn.

    Returns
    -------
    dict
        What the manifest says of it: ``missing_pictures``, the reason by file name.
    """
    gallery = Gallery()
    gallery.add_all(ALL, draw)
    for name, data in gallery.items():
        folder.write(name, data)
    if notify is not None:
        for line in lines_of(gallery.missing):
            notify(f"warning: {line}")
    return {"missing_pictures": gallery.missing}
