"""Make every figure, table and picture of the documents from the product, or check them.

Run: python docs/make.py                 rewrite what has changed
     python docs/make.py --check         exit code 1 where something no longer holds, a line each
     python docs/make.py --check --slow  the same with what takes long
     python docs/make.py --only NAME     some makers alone, by the beginning of their name
     python docs/make.py --list          all makers, and what is measured elsewhere

A figure in a sentence holds within three combined standard errors where it has one, else to its
last digit. Results are the same for any number of threads and jobs.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from making import makers, pictures, timings
from making.pages import ROOT, Block, Finding, Page, Picture, Says, Statement
from making.registry import MAKERS, Maker, run

from pmopt.storage.files import write_atomic


def chosen(only: Sequence[str], slow: bool) -> list[Maker]:
    """Return the makers that are to run, those that take longest first."""
    found = [
        m
        for m in MAKERS.values()
        if (any(m.name.startswith(name) for name in only) if only else slow or not m.slow)
    ]
    return sorted(found, key=lambda m: (not m.slow, not m.name.startswith("commands")))


def state(found: Sequence[Maker], jobs: int, progress: bool) -> list[Statement | Finding]:
    """Run makers, some at once, and return all that they state, in their order."""
    os.environ["NUMBA_NUM_THREADS"] = "1"  # of the processes to come
    context = multiprocessing.get_context("spawn")
    stated: list[Statement | Finding] = []
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=_prepare) as pool:
        results = pool.map(run, [m.name for m in found])
        for number, (each, result) in enumerate(zip(found, results, strict=True), start=1):
            if progress:
                print(f"[{number}/{len(found)}] {each.name}", file=sys.stderr, flush=True)
            stated += result
    return stated


def _prepare() -> None:
    makers.register()


def compare(stated: Iterable[Statement | Finding], write: bool) -> list[Finding]:
    """Return what of the documents does not hold, and write it as it is now if asked to."""
    pages: dict[str, Page] = {}
    findings = []
    for each in stated:
        if isinstance(each, Finding):
            findings.append(each)
        elif isinstance(each, Picture):
            findings += pictures.compare(each, write)
        else:
            assert isinstance(each, Says | Block)
            pages.setdefault(each.page, Page.read(each.page)).compare(each)
    for page in pages.values():
        findings += page.findings
        if write and page.rewritten != page.text:
            write_atomic(ROOT / page.path, page.rewritten)
    return sorted(findings, key=lambda f: (f.page, f.line))


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 where stale")
    parser.add_argument("--slow", action="store_true", help="check what takes long too")
    parser.add_argument("--only", action="append", default=[], metavar="NAME")
    parser.add_argument("--list", action="store_true", help="list the makers")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N")
    arguments = parser.parse_args()
    makers.register()
    if arguments.list:
        for each in MAKERS.values():
            print(f"{each.name}{' (slow)' if each.slow else ''}: {each.about}")
        print(timings.summary())
        return 0
    found = chosen(arguments.only, arguments.slow or not arguments.check)
    if not found:
        parser.error(f"no maker begins with {' or '.join(arguments.only)}; --list names them")
    stated = state(found, arguments.jobs, progress=sys.stderr.isatty())
    findings = compare(stated, write=not arguments.check)
    for finding in findings:
        print(finding)
    if arguments.check:
        return 1 if findings else 0
    return 1 if any(not f.mended for f in findings) else 0


if __name__ == "__main__":
    sys.exit(main())
