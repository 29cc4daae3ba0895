"""Figures of the pages of motions and dynamics."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import pmopt
from making.figures import Figure, rounded
from making.pages import ROOT, Says, Statement, table, verbatim
from making.registry import maker
from making.words import printed
from pmopt.analysis.motion.waypoint_laws import law_of
from pmopt.mechanisms import find, names
from pmopt.reporting.runs.simulate_run import SimulationRun

PAGE, MOTION = "docs/dynamics.md", "docs/motion.md"
MOTIONS = ROOT / "configs" / "motion"
#: The shipped motions that are regular, and the table's order.
SHIPPED = (
    "2uu-upu-t1",
    "3-cur-eq16",
    "4-ups-rps-home",
    "2pauu-ppap-pick-and-place",
    "3-ups-sp-strokes",
)


@maker("dynamics-bodies")
def bodies() -> Iterator[Statement]:
    """Yield what the engine's models consist of, at home."""
    from pmopt.analysis.multibody.mjcf import to_mjcf
    from pmopt.analysis.multibody.model import declared_tree
    from pmopt.analysis.multibody.mujoco_engine import Engine

    rows = []
    for name in sorted(names()):
        mechanism = find(name)
        tree = declared_tree(mechanism)
        engine = Engine(to_mjcf(tree), tree.actuated)
        equations = len(engine.partial(engine.model.qpos0)[1])
        freedoms = engine.model.nv
        dependent = equations - (freedoms - len(mechanism.joints))
        rows.append((name, *map(str, (len(tree.links), freedoms, equations, dependent))))
    head = ("", "bodies moving", "freedoms of the tree", "equations", "of them dependent")
    yield table(PAGE, "bodies", head, rows)


def _errors(run: SimulationRun) -> dict[str, float]:
    return {a.joint: a.error for a in run.agreements if a.mode == "forward"}


def _two(value: float) -> str:
    """Return a number with two digits."""
    text = f"{value:#.2g}"
    return text.rstrip(".") if "e" not in text else f"{value:.5f}"


def _about(value: float) -> Figure:
    """Return an error of a simulation: the engine's last digits differ between machines."""
    return Figure(_two(value), value, within=0.02 * value)


@maker("dynamics-agreement")
def agreement() -> Iterator[Statement]:
    """Yield how well the engine agrees with the shipped motions."""
    import mujoco

    rows = []
    for name in SHIPPED:
        run = pmopt.simulate(MOTIONS / f"{name}.toml")
        found = _errors(run)
        worst = max(found, key=lambda k: found[k])
        inverse = "< 1e-9" if run.worst < 1e-9 else f"{run.worst:.1e}"
        by_joint = ", ".join(f"{joint} {_two(error)}" for joint, error in found.items())
        rows.append(
            (f"`{name}`", f"{run.simulation.hold:g}", inverse, _about(found[worst]), by_joint)
        )
    head = ("NAME", "hold (s)", "inverse (%)", "forward (%)", "forward, by joint (%)")
    yield table(PAGE, "agreement", head, rows)
    yield Says(PAGE, "(MuJoCo {}, steps of 1 ms;", (mujoco.__version__,))


@maker("dynamics-gains", slow=True)
def gains() -> Iterator[Statement]:
    """Yield what the paper's gains and other holds leave."""

    def simulated(name: str, changes: dict[str, object], **controller: object) -> dict[str, float]:
        data = tomllib.loads((MOTIONS / f"{name}.toml").read_text())
        data["trajectory"] |= changes
        data["controller"] = controller
        return _errors(pmopt.simulate(data))

    paper = simulated(
        "2uu-upu-t1", {"duration": 4.0}, kp=21.0, ki=21 / 3.2813, kd=21 * 0.3857,
        feedforward=True, hold=0.01,
    )  # fmt: skip
    bound = 10.0 ** np.ceil(np.log10(max(paper.values())))
    yield Says(PAGE, "with feed-forward, ours stay below {} %", (f"{bound:g}",))
    hold = simulated("2pauu-ppap-pick-and-place", {}, feedforward=True, hold=0.01)
    yield Says(PAGE, "change by more than half their peak in that time, has an error of {} %",
               (rounded(max(hold.values()), ".0f", within=0.1),))  # fmt: skip
    lag = simulated("2uu-upu-t1", {}, feedforward=False, hold=0.001)
    yield Says(PAGE, "lags: {}, {} and {} % on `2uu-upu-t1`",
               tuple(rounded(v, ".1g", within=0.03 * v) for v in lag.values()))  # fmt: skip


@maker("motion-laws")
def laws() -> Iterator[Statement]:
    """Yield the peaks of the laws of time."""
    law = law_of("quintic", 0.25)
    yield Says(MOTION, "| `quintic` | 10 u^3 - 15 u^4 + 6 u^5 | {} | {} |",
               (rounded(law.peak_rate, ".3f"), rounded(law.peak_acceleration, ".3f")))  # fmt: skip


@maker("motion-infeasible")
def infeasible() -> Iterator[Statement]:
    """Yield what an infeasible motion prints."""
    command = ("motion", "configs/motion/4-ups-rps-paper.toml")
    said = printed(*command).splitlines()[0]
    # The index there is 0 to rounding, and rounding is the machine's.
    said = re.sub(r"; worst at .*", "; ..", said)
    yield verbatim(MOTION, "infeasible", f"$ pmopt {' '.join(command)}\n{said}")


@maker("motion-tables")
def tables() -> Iterator[Statement]:
    """Check that every shipped motion is in the page's table."""
    shipped = {path.stem for path in Path(MOTIONS).glob("*.toml")}
    for name in sorted(shipped):
        yield Says(MOTION, f"\n| `{name}` | ")
