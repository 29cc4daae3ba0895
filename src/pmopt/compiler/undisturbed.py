"""Compile whatever is set for other programs that use numba: its settings are the process's.

``NUMBA_DISABLE_JIT=1``, left from a debugger or from a measurement of coverage, would keep kernels
from being compiled; ``NUMBA_DUMP_IR=1`` would print into a result.
"""

from __future__ import annotations

import importlib
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

_OFF = (
    "DISABLE_JIT", "BOUNDSCHECK", "DEBUG", "DEBUGINFO", "DEBUG_FRONTEND", "DEBUG_JIT",
    "DEBUG_TYPEINFER", "DEBUG_CACHE", "DEBUG_PRINT_AFTER", "DUMP_BYTECODE", "DUMP_CFG", "DUMP_IR",
    "DUMP_SSA", "DUMP_LLVM", "DUMP_FUNC_OPT", "DUMP_OPTIMIZED", "DUMP_ASSEMBLY", "TRACE",
    "ENABLE_PROFILING", "JIT_COVERAGE",
)  # fmt: skip
#: Variables of the environment without effect on kernels.
IDLE = tuple(f"NUMBA_{name}" for name in _OFF)
_OFF_VALUES = {"BOUNDSCHECK": None, "DEBUG_PRINT_AFTER": "none"}


@contextmanager
def undisturbed() -> Iterator[None]:
    """Let numba compile, and print nothing, whatever is set for other programs."""
    threads = os.environ.get("NUMBA_NUM_THREADS", "1")
    hidden = [name for name in IDLE if name in os.environ]
    if not (threads.isascii() and threads.isdigit() and int(threads) > 0):
        hidden.append("NUMBA_NUM_THREADS")  # numba would complain at length
    kept = {name: os.environ.pop(name) for name in hidden}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            config = importlib.import_module("numba.core.config")
            before = {name: getattr(config, name) for name in _OFF if hasattr(config, name)}
            try:
                for name in before:
                    setattr(config, name, _OFF_VALUES.get(name, 0))
                yield
            finally:
                for name, value in before.items():
                    setattr(config, name, value)
    finally:
        os.environ.update(kept)
