"""What may lie where a file should be, made at a path, a function each."""

import os
import signal
import threading

from support.cli_runner import TIMEOUT, here


def pipe(path):
    os.mkfifo(path)


def folder_of_that_name(path):
    path.mkdir()


def nested(path):
    path.write_text("[" * 100_000 + "]" * 100_000)


def nested_keys(path):
    path.write_text('{"command": ' + '{"a": ' * 500 + "1" + "}" * 501)


def sparse(path):
    with path.open("wb") as stream:
        stream.truncate(1 << 30)


def not_text(path):
    path.write_bytes(b'{"command": "\xff\xfe"}')


def other_things(path):
    path.write_text('{"command": "pareto", "config": [1], "outputs": 3, "units": {"a": NaN}}')


def no_names(path):
    path.write_text('{"command": "pareto", "config": 7, "outputs": {}, "wall_time": "x"}')


def empty(path):
    path.write_bytes(b"")


def unreadable(path):
    path.symlink_to(path)


STRANGE = [pipe, folder_of_that_name, nested, nested_keys, sparse, not_text, other_things, no_names,
           empty, unreadable]  # fmt: skip


def in_time(*words, cwd):
    """Run a command, ended by an alarm where it hangs."""
    timer = threading.Timer(TIMEOUT, lambda: os.kill(os.getpid(), signal.SIGABRT))
    timer.start()
    try:
        return here(*words, cwd=cwd)
    finally:
        timer.cancel()
