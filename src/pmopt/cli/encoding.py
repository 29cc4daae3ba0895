"""What a terminal or file of another encoding gets in the place of characters it lacks."""

from __future__ import annotations

import codecs
import contextlib
import io
import sys

#: Name of the error handler.
HANDLER = "pmopt"
_PLAIN = str.maketrans(
    {
        "±": "+-", "≤": "<=", "≥": ">=", "·": "*", "°": "deg", "⁻": "^-", "\u2212": "-",
        "\u2013": "-", "\u2026": "...", "─": "-", "\u00d7": "x", "\u00a0": " ",
        **{raised: f"^{k}" for k, raised in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")},
    }
)  # fmt: skip
#: Bytes of a file's name that are no text, as Python keeps them.
_ESCAPED = range(0xDC80, 0xDD00)


def substitute(error: UnicodeError) -> tuple[str, int]:
    """Return the nearest plain text for characters that an encoding lacks, and where to go on."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    if all(ord(c) in _ESCAPED for c in text):
        return "".join(f"\\x{ord(c) - 0xDC00:02x}" for c in text), error.end
    plain = text.translate(_PLAIN)
    return "".join(c if c.isascii() else "?" for c in plain), error.end


codecs.register_error(HANDLER, substitute)


def writable(text: str) -> str:
    """Return a text in characters that stdout can write."""
    code = sys.stdout.encoding or "utf-8"
    return text.encode(code, HANDLER).decode(code)


def make_lenient() -> None:
    """Let stdout and stderr print what their encoding lacks as plain text."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            with contextlib.suppress(OSError, ValueError, LookupError):
                stream.reconfigure(errors=HANDLER)
