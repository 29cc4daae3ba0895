"""Kill runs and feed commands anything, as often as is asked for, and print what came of it.

    python tests/support/campaign.py --kills 300 --interrupts 100 --fuzz 5000

What the tests do some dozens of times. Every failure is printed; the exit code is 1 if there was
one. ``--wide`` takes all mechanisms and options, whose kernels take minutes to compile.
"""

import argparse
import collections
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from pmopt.analysis.sampling.tallies import BLOCK_CHUNKS, CHUNK
from pmopt.reporting.runs import workspace_checkpoint
from support import fuzz_checks, fuzzing, interrupting
from support.killing import Killed, checkpoints, kill_and_resume, outputs, start

BLOCK = BLOCK_CHUNKS * CHUNK
SEARCH = """
mechanism = "2pauu-ppap"
[parameters]
m = [0.5, 1.5]
n = 0.7
c = 0.1
[workspace]
samples = {samples}
[algorithm]
population = 16
generations = {generations}
seed = {seed}
[final]
target_error = 1e-2
"""
WORKSPACE = ("workspace", "2pauu-ppap", "--shape-grid", "0", "--seed")


def kills(count, number):
    """Kill runs of every kind until there were so many kills; return what they have met."""
    chance = random.Random(number)
    kinds = {
        "pareto": ("pareto", SEARCH.format(samples=2000, generations=40, seed=number)),
        "pareto, adaptive": (
            "pareto", SEARCH.format(samples='"adaptive"', generations=30, seed=number)),
        "workspace": (*WORKSPACE, number, "--samples", 30 * BLOCK),
        "workspace to an error": (
            *WORKSPACE, number, "--target-error", "1.5e-4", "--sampler", "monte-carlo"),
        "workspace, grid": (*WORKSPACE, number, "--grid", "420"),
    }  # fmt: skip
    met = {name: Killed() for name in kinds}
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)

        def whole(kind):
            words = kinds[kind]
            folder = home / kind
            folder.mkdir()
            if words[0] == "pareto":
                (folder / "test.toml").write_text(words[1])
                words = ("pareto", "test.toml")
            process = start(words, folder / "whole")
            _, errors = process.communicate()
            assert process.returncode == 0, errors
            return words, folder, checkpoints(folder / "whole")[-1]

        whole_runs = {kind: whole(kind) for kind in kinds}

        def one(job):
            kind, k, stream = job
            if sum(m.kills for m in met.values()) >= count:
                return
            words, folder, last = whole_runs[kind]
            run = folder / str(k)
            found = kill_and_resume(words, run, random.Random(stream), last)
            assert outputs(run) == outputs(folder / "whole"), f"other bytes: {kind}, {stream}"
            assert not list(run.rglob("*.pmopt-tmp")), kind
            met[kind].add(found)
            shutil.rmtree(run)

        jobs = [(kind, k, chance.getrandbits(64)) for k in range(count) for kind in kinds]
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(one, jobs))
    return met


def interruptions(count, number):
    """Interrupt commands at random moments; return the seconds each took to end."""
    chance, took = random.Random(number), []
    for k in range(count):
        phase = chance.choice(list(interrupting.PHASES))
        # Later than the interpreter needs to take the signals over.
        wait = chance.uniform(0.1, 2 * interrupting.PHASES[phase][2])
        with tempfile.TemporaryDirectory() as name:
            signum = (signal.SIGINT, signal.SIGTERM)[k % 2]
            found = interrupting.interrupted(phase, signum, Path(name), wait)
            code, _, errors, seconds = found
            if code is None:
                continue  # it had ended
            assert code == 130, (phase, wait, code, errors)
            assert errors.startswith("error: interrupted"), (phase, errors)
            assert errors.count("\n") == 1, (phase, errors)
            took.append((seconds, phase))
    return took


def fuzz(check, strategy, count, number):
    """Check so many examples; return how they ended and what failed."""
    ends, failures = collections.Counter(), []

    @seed(number)
    @settings(max_examples=count, database=None, derandomize=False, deadline=None,
              suppress_health_check=list(HealthCheck), phases=[Phase.generate])  # fmt: skip
    @given(strategy)
    def each(example):
        try:
            ends[check(example)] += 1
        except Exception:
            ends["FAILED"] += 1
            failures.append(f"{example}\n{traceback.format_exc(limit=-3)}")

    each()
    return ends, failures


def main():
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--fuzz", type=int, default=500, help="examples of each kind")
    parser.add_argument("--interrupts", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--wide", action="store_true")
    options = parser.parse_args()
    bad = 0
    if options.kills:
        began = time.monotonic()
        for kind, met in kills(options.kills, options.seed).items():
            print(f"{kind}: {met.kills} kills survived in {met.runs} runs, {met.torn} of them "
                  f"while a file was written, {met.after} after the last checkpoint")  # fmt: skip
        print(
            f"every run ended in the bytes of the run in one go; {time.monotonic() - began:.0f} s"
        )
    if options.interrupts:
        took = interruptions(options.interrupts, options.seed)
        seconds, phase = max(took)
        print(f"{len(took)} interruptions: all ended with one line and exit 130, the slowest after "
              f"{seconds:.2f} s ({phase})", flush=True)  # fmt: skip
    kept = {}
    kinds = {
        "ik, fk, jacobian": (fuzz_checks.poses, fuzzing.pose_commands()),
        "workspace options": (
            fuzz_checks.workspaces, fuzzing.workspace_commands(wide=options.wide)),
        "configurations": (fuzz_checks.searches, fuzzing.search_configs(wide=options.wide)),
        "motions": (fuzz_checks.motions, fuzzing.motion_configs(wide=options.wide)),
        "motors": (fuzz_checks.capabilities, fuzzing.capability_commands(wide=options.wide)),
        "checkpoints": (
            lambda example: fuzz_checks.checkpoints(example, kept),
            st.tuples(st.sampled_from(sorted(fuzz_checks.RUNS)), st.data()),
        ),
    }  # fmt: skip
    workspace_checkpoint.EVERY = 0.0
    with fuzzing.nothing_drawn():
        for kind, (check, strategy) in kinds.items() if options.fuzz else ():
            began = time.monotonic()
            ends, failures = fuzz(check, strategy, options.fuzz, options.seed)
            counts = ", ".join(f"{n} {how}" for how, n in ends.most_common())
            print(f"{kind}: {sum(ends.values())} examples: {counts}; "
                  f"{time.monotonic() - began:.0f} s", flush=True)  # fmt: skip
            bad += len(failures)
            for failure in failures[:10]:
                print(failure, file=sys.stderr)
    for folder in kept.values():
        shutil.rmtree(folder)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
