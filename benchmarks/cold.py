"""CPU of first answers on an empty cache of kernels, against another commit's.

    python benchmarks/cold.py --against /path/of/another/checkout [--mechanism NAME ..]

Every command runs in a process of its own with a new ``$PMOPT_CACHE_DIR``, once with each of both
sources in turn; counted is the processor time of the process and of all that it starts. Then the
same again on the cache that is now warm, and workspaces with one option changed, each on a cache
that holds the kernels of the first.
"""

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
#: What comes first, by name of the command; MECH stands for the mechanism,
#: MOTION for an example of its motion.
FIRST = {
    "workspace": ("workspace", "MECH", "--samples", "65536"),
    "capability": ("capability", "MECH", "--samples", "2048", "--payload", "2", "--speed", "0.1"),
    "singularities": ("singularities", "MECH", "--samples", "2048"),
    "certify": ("certify", "MECH", "--box-budget", "1000"),
    "motion": ("motion", "MOTION"),
}
#: What is changed after the first workspace.
CHANGED = {
    "norm": ("--norm", "fro"),
    "sampler": ("--sampler", "sobol"),
    "samples": ("--samples", "131072"),
    "regions": ("--regions", "0,0.2,0.5,1"),
    "index": ("--min-lci", "0.1"),
    "links": ("--link-diameter", "10mm"),
}


def spent(source: Path, cache: str, arguments: tuple[str, ...]) -> float:
    """Return the processor time, s, of a command and its children with one source."""
    env = os.environ | {
        "PYTHONPATH": str(source / "src"), "PMOPT_CACHE_DIR": cache, "NUMBA_NUM_THREADS": "1",
    }  # fmt: skip
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "pmopt", *arguments], env=env, cwd=source, capture_output=True,
        text=True,
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 3, 4):
        raise SystemExit(f"{' '.join(arguments)}: {done.stderr.strip()[-300:]}")
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


class Cases:
    """Times of two sources, case by case."""

    def __init__(self, sources: tuple[Path, Path], repeats: int) -> None:
        self.sources = sources
        self.repeats = repeats

    def row(self, label: str, arguments: tuple[str, ...], kept: tuple[str, str] | None) -> None:
        """Print what a command takes on a copy of what is kept, and again, warm."""
        cold: list[list[float]] = [[], []]
        warm: list[list[float]] = [[], []]
        for k in range(self.repeats):
            for which in (0, 1) if k % 2 else (1, 0):
                with tempfile.TemporaryDirectory() as folder:
                    cache = str(Path(folder) / "cache")
                    if kept is not None:
                        shutil.copytree(kept[which], cache)
                    cold[which].append(spent(self.sources[which], cache, arguments))
                    warm[which].append(spent(self.sources[which], cache, arguments))
        old, new = (statistics.median(values) for values in cold)
        old_warm, new_warm = (statistics.median(values) for values in warm)
        more = [a - b for a, b in ((old, old_warm), (new, new_warm))]
        print(
            f"{label:24s} {old:7.2f} {new:7.2f} {new / old:7.3f} {old_warm:7.2f} {new_warm:7.2f}"
            f" {more[0]:8.2f} {more[1]:8.2f}",
            flush=True,
        )

    def of(self, mechanism: str, commands: list[str], changes: list[str]) -> None:
        """Print all cases of a mechanism."""
        for name in commands:
            motions = sorted((HERE / "configs/motion").glob(f"{mechanism}-*.toml"))
            said = {"MECH": mechanism, "MOTION": str(motions[0]) if motions else ""}
            words = tuple(said.get(word, word) for word in FIRST[name])
            self.row(f"{mechanism} {name}", words, None)
        with tempfile.TemporaryDirectory() as folder:
            kept = (f"{folder}/old", f"{folder}/new")
            first = tuple(mechanism if w == "MECH" else w for w in FIRST["workspace"])
            if changes:
                for source, cache in zip(self.sources, kept, strict=True):
                    spent(source, cache, first)
            for name in changes:
                self.row(f"{mechanism} {name}", (*first, *CHANGED[name]), kept)


def main() -> None:
    """Run the cases asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--against", type=Path, default=HERE, help="checkout to compare with")
    parser.add_argument("--mechanism", nargs="*", default=["2pauu-ppap"])
    parser.add_argument("--commands", nargs="*", default=list(FIRST), choices=list(FIRST))
    parser.add_argument("--changes", nargs="*", default=list(CHANGED), choices=list(CHANGED))
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    cases = Cases((given.against.resolve(), HERE), given.repeats)
    print(f"{'CPU, s':24s} {'before':>7s} {'now':>7s} {'ratio':>7s} {'warm before, now':>15s}"
          f" {'compiling before, now':>17s}")  # fmt: skip
    for mechanism in given.mechanism:
        cases.of(mechanism, given.commands, given.changes)


if __name__ == "__main__":
    main()
