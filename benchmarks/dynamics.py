"""Inverse dynamics of whole motions against MuJoCo on the same model.

The peer is what a script does: for every instant `mj_inverse` on the open tree, in a loop of
Python, given the joints of the closed loops. Finding those, and projecting on the actuated joints,
is ours alone in this comparison; both have to agree first. Ours takes one thread.

Run: python benchmarks/dynamics.py [--instants 100000] [--pairs 5]
"""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from pmopt.analysis.motion.config import load_motion
from pmopt.analysis.motion.dynamics import Mover
from pmopt.analysis.motion.motion import Loads, compute_motion
from pmopt.analysis.motion.trajectories import plan_trajectory
from pmopt.analysis.multibody.mjcf import to_mjcf
from pmopt.analysis.multibody.mujoco_engine import Engine
from pmopt.analysis.multibody.simulation import simulate_motion, tree_of

MOTIONS = Path(__file__).resolve().parents[1] / "configs" / "motion"
NAMES = ("2pauu-ppap-pick-and-place", "2uu-upu-t1", "3-cur-eq16", "3-ups-sp-strokes",
         "4-ups-rps-home")  # fmt: skip
LOOP = 2000
TOLERANCE = 1e-6  # % of a joint's peak


def compare(name: str, instants: int, pairs: int) -> None:
    """Check agreement on a shipped motion, then time both interleaved."""
    task = load_motion(MOTIONS / f"{name}.toml")
    bare = task.config.model_copy(update={"controller": None})
    planned = plan_trajectory(task).trajectory
    motion = compute_motion(
        task.mechanism, task.parameters, planned,
        loads=Loads(task.bodies, task.payload, task.config.gravity),
    )  # fmt: skip
    simulation = simulate_motion(replace(task, config=bare), motion)
    error = float(np.abs(simulation.inverse.error).max())
    if not error < TOLERANCE:
        raise SystemExit(f"{name}: the engine differs by {error:.3g} %")

    mode = task.mechanism.working_modes[0]
    load = () if task.payload is None else (task.payload.body("payload"),)
    mover = Mover(task.mechanism, task.parameters, mode, (*task.bodies, *load), threads=1)
    some = np.arange(instants) % len(motion.t)
    poses, rates, changes = (np.ascontiguousarray(a[some]) for a in (
        motion.pose.values, motion.pose.rates, motion.pose.accelerations
    ))  # fmt: skip
    start = dict(zip([c.name for c in motion.pose.coordinates], motion.pose.values[0].tolist(),
                     strict=True))  # fmt: skip
    tree = tree_of(task, start)
    model = Engine(to_mjcf(tree), tree.actuated).model
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    data = mujoco.MjData(model)
    q, v = np.zeros(model.nq), np.full(model.nv, 0.1)
    q[:] = model.qpos0
    ours, theirs = [], []
    mover.state(poses[:10], rates[:10], changes[:10])
    for _ in range(pairs):
        began = time.process_time()
        mover.state(poses, rates, changes)
        ours.append((time.process_time() - began) / instants)
        began = time.process_time()
        for _ in range(LOOP):
            data.qpos[:] = q
            data.qvel[:] = v
            data.qacc[:] = v
            mujoco.mj_inverse(model, data)
            data.qfrc_inverse.copy()
        theirs.append((time.process_time() - began) / LOOP)
    ratios = sorted(b / a for a, b in zip(ours, theirs, strict=True))
    print(
        f"{name:26s} {1e6 * statistics.median(ours):6.2f} us an instant, all of it; MuJoCo's open "
        f"tree alone {1e6 * statistics.median(theirs):6.2f} us: {statistics.median(ratios):.2f} "
        f"times ({ratios[0]:.2f} .. {ratios[-1]:.2f}); errors below {TOLERANCE:g} %"
    )


def main() -> None:
    """Compare on every shipped feasible motion."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instants", type=int, default=100_000)
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("motions", nargs="*", default=NAMES)
    given = parser.parse_args()
    for name in given.motions:
        compare(name, given.instants, given.pairs)


if __name__ == "__main__":
    main()
