"""The text of files as Windows, Excel and PowerShell write them."""

from __future__ import annotations

import codecs
import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from pmopt.inputs.reading import LARGEST, open_given, read_given

#: Byte-order marks; the longer ones first, since that of UTF-32 begins with that of UTF-16.
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
#: Bytes that are looked at at once.
_BLOCK = 1 << 18


def decode(data: bytes, *, legacy: bool = False) -> str:
    """Return the text of a file: UTF-8 or UTF-16, with or without a byte-order mark.

    Parameters
    ----------
    data : bytes
    legacy : bool
        Whether what is no UTF-8 is read as Windows-1252, which older programs write.

    Raises
    ------
    ValueError
        For bytes that are no text.
    """
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return data[len(mark) :].decode(encoding)
    # Without a mark every second byte of Latin text in UTF-16 is zero; UTF-8 has no zeros.
    if b"\0" in data[:2]:
        text = data.decode("utf-16-be" if data[0] == 0 else "utf-16-le")
    else:
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError:
            if not legacy:
                raise
            text = data.decode("cp1252")
    if "\0" in text:
        raise ValueError("it holds zero bytes, which no text has")
    return text


def read_text(path: Path, *, legacy: bool = False, largest: int = LARGEST) -> str:
    """Return the text of a file of at most ``largest`` bytes; see :func:`decode`.

    Raises
    ------
    OSError, ValueError
        See :func:`pmopt.inputs.reading.read_given`.
    """
    return decode(read_given(path, largest), legacy=legacy)


class Lines:
    """The lines of a file, as often as they are asked for, in little memory.

    Only one iteration goes on at a time. Ends of lines are kept.

    Parameters
    ----------
    stream : binary file
        That can be read again.
    legacy : bool
        See :func:`decode`.

    Attributes
    ----------
    count : int
        Ends of lines; a line feed behind a carriage return is none of its own.

    Raises
    ------
    ValueError
        For bytes that are no text.
    """

    def __init__(self, stream: BinaryIO, *, legacy: bool = False) -> None:
        self._stream = stream
        stream.seek(0)
        head = stream.read(4)
        self._start, wanted = 0, ["utf-8", *(["cp1252"] if legacy else [])]
        for mark, encoding in _MARKS:
            if head.startswith(mark):
                self._start, wanted = len(mark), [encoding]
                break
        else:
            if b"\0" in head[:2]:
                wanted = ["utf-16-be" if head[0] == 0 else "utf-16-le"]
        for self._encoding in wanted:
            try:
                self.count = self._looked_over()
                return
            except UnicodeDecodeError:
                if self._encoding == wanted[-1]:
                    raise

    def _looked_over(self) -> int:
        """Return the number of ends of lines; all of the text is decoded once."""
        decoder = codecs.getincrementaldecoder(self._encoding)()
        self._stream.seek(self._start)
        ends = {"\n": 0, "\r": 0}
        while True:
            block = self._stream.read(_BLOCK)
            text = decoder.decode(block, not block)
            if "\0" in text:
                raise ValueError("it holds zero bytes, which no text has")
            for end in ends:
                ends[end] += text.count(end)
            if not block:
                return max(ends.values())

    def __iter__(self) -> Iterator[str]:
        """Yield the lines."""
        self._stream.seek(self._start)
        decoder = codecs.getincrementaldecoder(self._encoding)()
        rest = ""
        while True:
            block = self._stream.read(_BLOCK)
            *whole, rest = [*(rest + decoder.decode(block, not block)).splitlines(True), ""]
            # What ends with the block may go on in the next one, a carriage return too.
            if block and whole and not rest:
                rest = whole.pop()
            yield from whole
            if not block:
                return


@contextlib.contextmanager
def open_lines(path: Path, *, legacy: bool = False) -> Iterator[Lines]:
    """Open a text file for reading its lines, more than once if need be.

    A pipe is copied to a temporary file.

    Raises
    ------
    OSError, ValueError
        See :func:`pmopt.inputs.reading.open_given` and :class:`Lines`.
    """
    with open_given(path) as stream:
        yield Lines(stream, legacy=legacy)
