"""The text of files as Windows, Excel and PowerShell write them."""

from __future__ import annotations

import codecs
from pathlib import Path

from pmopt.inputs.reading import LARGEST, read_given

#: Byte-order marks; the longer ones first, since that of UTF-32 begins with that of UTF-16.
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


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
