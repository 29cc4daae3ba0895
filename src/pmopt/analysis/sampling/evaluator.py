"""What the compiled kernel finds at poses: reach, index, places, and their sums over points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.design_space import Design, DesignSpace
from pmopt.analysis.sampling.tallies import CHUNK, Tallies
from pmopt.compiler.machine_code import Program
from pmopt.compiler.program_text import ENTRIES, PLACE, Recipe, Sweep, specialise
from pmopt.execution.threads import default_threads, ordered_map
from pmopt.kernels import sweep
from pmopt.mechanisms.mechanism import Mechanism, Vector
from pmopt.numerics import sequences
from pmopt.numerics.matrices import product

Notify = Callable[[str], None]

#: Entries that the search for the extremes of the index calls.
_SEARCHING = ("field", "points", "probe")
#: Numbers in a line of the cache.
_LINE = 8
_STRIPS = 4096
_FEW = 4096


@dataclass(frozen=True)
class Facts:
    """What the kernel and the skeleton give for N poses.

    Attributes
    ----------
    margin : (N,) float64
    entries : (N, n, n) float64
        A multiple of the inverse Jacobian; a change of sign of its determinant is a singularity.
    position, tool : (N, 3) float64
        Of the platform's centre, and of the tool point (the same where there is no tool).
    rotation : (N, 3, 3) float64
    segments : (N, s, 2, 3) float64
    """

    margin: Vector
    entries: NDArray[np.float64]
    position: NDArray[np.float64]
    tool: NDArray[np.float64]
    rotation: NDArray[np.float64]
    segments: NDArray[np.float64]


@dataclass(eq=False)
class Evaluator:
    """The compiled kernel of one mechanism under settings; a call is of one design or some.

    Attributes
    ----------
    space : DesignSpace
    threads : int
        Those of :meth:`field` and :meth:`probe`; results do not depend on it.
    program, sweeping : Sweep
        The kernel's entries, and what has its sweep: on lines a program of its own.
    recipe : Recipe
        What ``program`` is specialised to.
    """

    space: DesignSpace
    threads: int
    program: Sweep
    sweeping: Sweep
    recipe: Recipe

    #: How many times more a pose costs than in the compiled sweep, roughly.
    slowness = 1

    @classmethod
    def of(
        cls, space: DesignSpace, threads: int | None = None, notify: Notify | None = None
    ) -> Evaluator:
        """Return the evaluator of the designs of a space.

        Parameters
        ----------
        space : DesignSpace
        threads : int, optional
            Default: see :func:`pmopt.execution.threads.default_threads`.
        notify : callable, optional
            Receives a line when kernels have to be compiled.
        """
        mechanism, settings = space.mechanism, space.settings
        recipe = Recipe(
            mechanism.kernel,
            mechanism.skeleton,
            len(mechanism.pose),
            mechanism.constants,
            len(mechanism.joints),
            settings.norm,
            mechanism.segments,
            mechanism.spokes,
            len(mechanism.cones),
            space.checks,
            switches=tuple(mechanism.switches(space.limits).items()),
        )
        said = notify is None

        def on_compile() -> None:
            nonlocal said
            if not said and notify is not None:
                said = True  # plain kernels and those on lines are one line
                notify(f"compiling the kernels of {mechanism.name}, once: some seconds")

        program = sweeping = specialise(recipe, on_compile)
        if settings.sampler == "lines":
            lines = recipe._replace(
                line=mechanism.line, line_axis=mechanism.line_axis, line_parts=mechanism.line_parts
            )
            sweeping = specialise(lines, on_compile)
        return cls(space, threads or default_threads(), program, sweeping, recipe)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism."""
        return self.space.mechanism

    @property
    def edges(self) -> NDArray[np.float64]:
        """The inner edges of the dexterity regions."""
        return np.array(self.space.settings.regions[1:-1], dtype=float)

    @property
    def kernels(self) -> dict[Program, tuple[str, ...]]:
        """The compiled texts and the entries that may be called."""
        found: dict[Program, tuple[str, ...]] = {self.sweeping: ("sweep",)}
        found[self.program] = (*found.get(self.program, ()), *ENTRIES[1:])
        return found

    @property
    def sampling_kernels(self) -> dict[Program, tuple[str, ...]]:
        """Of :attr:`kernels`, what sampling calls."""
        return {self.sweeping: ("sweep",)}

    @property
    def measuring_kernels(self) -> dict[Program, tuple[str, ...]]:
        """Of :attr:`kernels`, what sampling and the search for extremes call."""
        found = self.sampling_kernels
        called = dict.fromkeys((*found.get(self.program, ()), *_SEARCHING))
        return found | {self.program: tuple(called)}

    def points(
        self, design: Design, points: sequences.Sequence, first: int, last: int
    ) -> NDArray[np.float64]:
        """Return the points ``first .. last - 1`` of the first replicate, shape (d, N)."""
        poses = np.empty((len(design.width), last - first))
        self.program.points(*points, first, last, design.lower, design.width, poses, self.scratch())
        return poses

    def tally(
        self,
        designs: Sequence[Design],
        points: sequences.Sequence,
        first: int,
        last: int,
        bins: int = 0,
    ) -> Tallies:
        """Sweep the points ``first .. last - 1`` of every replicate for some designs."""
        count, replicates = len(designs), points.replicates
        edges = self.edges
        statistics = np.empty((count, replicates, sweep.STATISTICS))
        above = np.empty((count, replicates, len(edges)))
        histogram = np.empty((count, replicates, bins))
        self.sweeping.sweep(
            *points,
            first,
            last,
            np.array([d.constants for d in designs]),
            np.array([d.lower for d in designs]),
            np.array([d.width for d in designs]),
            self.space.settings.min_lci,
            edges,
            statistics,
            above,
            histogram,
            self.scratch(),
            np.empty(sweep.BLOCK, dtype=np.int64),
        )
        box = np.array([d.box_volume for d in designs])
        # An empty box is a single point repeated: nothing of it counts as reachable.
        empty = box == 0.0
        statistics[empty, :, : sweep.MIN_LCI] = 0.0
        statistics[empty, :, sweep.WITHIN :] = 0.0
        above[empty] = 0
        histogram[empty] = 0
        reachable, total, smallest, largest, margin, within, hits = np.moveaxis(statistics, 2, 0)
        return Tallies(
            last - first, box, reachable, within, hits, total, smallest, largest, margin,
            above, histogram,
        )  # fmt: skip

    def field(self, design: Design, poses: NDArray[np.float64]) -> tuple[Vector, Vector]:
        """Return margin and LCI at given poses, shape (d, N), in the box or not.

        The index is not masked: outside the limits it continues the inside, out of reach it is 0.
        """
        size = poses.shape[1]
        margin, lci = np.empty(size), np.empty(size)
        constants = np.array(design.constants)
        step = CHUNK // 4

        def evaluate(start: int) -> None:
            part = slice(start, min(start + step, size))
            self.program.field(
                np.ascontiguousarray(poses[:, part]), constants, margin[part], lci[part],
                self.scratch(),
            )  # fmt: skip

        for _ in ordered_map(evaluate, range(0, size, step), self.threads):
            pass
        return margin, lci

    def probe(self, design: Design, poses: NDArray[np.float64]) -> Facts:
        """Return what kernel and skeleton give for given poses, shape (d, N)."""
        mechanism = self.space.mechanism
        n, segments, size = len(mechanism.joints), len(mechanism.segments), poses.shape[1]
        facts = np.empty((1 + n * n + PLACE + 6 * segments + len(mechanism.cones), size))
        constants = np.array(design.constants)
        step = CHUNK // 16

        def evaluate(start: int) -> None:
            part = slice(start, min(start + step, size))
            found = np.empty((len(facts), part.stop - start))
            self.program.probe(np.ascontiguousarray(poses[:, part]), constants, found)
            facts[:, part] = found

        for _ in ordered_map(evaluate, range(0, size, step), self.threads):
            pass
        place = 1 + n * n
        position = facts[place : place + 3].T
        rotation = facts[place + 3 : place + PLACE].T.reshape(size, 3, 3)
        ends = facts[place + PLACE : place + PLACE + 6 * segments].T.reshape(size, segments, 2, 3)
        tool = position + product(rotation, np.array(self.space.settings.tool or (0.0, 0.0, 0.0)))
        entries = facts[1:place].T.reshape(size, n, n)
        return Facts(facts[0], entries, position, tool, rotation, ends)

    def locate(
        self, design: Design, poses: NDArray[np.float64]
    ) -> tuple[Vector, NDArray[np.float64]]:
        """Return slack and place of the platform's centre, or the tool point, at poses (d, N).

        The slack (N,) is >= 0 where a pose is reachable, and continuous; the places are (3, N).
        """
        size = poses.shape[1]
        margin, places = np.empty(size), np.empty((3, size))
        constants = np.array(design.constants)
        tool = np.array(self.space.settings.tool or (0.0, 0.0, 0.0))
        self.program.locate(
            np.ascontiguousarray(poses), constants, tool, margin, places, self.scratch()
        )
        if self.space.settings.min_lci > 0:
            margin = np.minimum(margin, self.field(design, poses)[1] - self.space.settings.min_lci)
        return margin, places

    def outline(
        self, design: Design, points: sequences.Sequence, first: int, last: int
    ) -> NDArray[np.float64]:
        """Return points on the floor whose convex hull is that of all links at sample poses.

        Of the points ``first .. last - 1`` of the first replicate those that are reachable, shape
        (K, 2); the least and the greatest in each of many strips bound the hull.
        """
        floor = [k for k in range(3) if k != self.space.mechanism.vertical]
        some = self.shadow(design, self.points(design, points, first, min(last, first + _FEW)))
        if len(some) == 0 or self.space.settings.min_lci > 0:
            return self.shadow(design, self.points(design, points, first, last))
        # A few poses show about how far the strips must reach.
        reach = max(1.2 * float(np.ptp(some[:, 0])), 1e-300)
        edge = float(some[:, 0].min()) - reach / 12
        lowest = np.full((_STRIPS + 1, 2), np.inf)
        highest = np.full((_STRIPS + 1, 2), -np.inf)
        self.program.outline(
            *points, first, last, np.array(design.constants), design.lower, design.width,
            *floor, edge, reach / _STRIPS, lowest, highest, self.scratch(),
        )  # fmt: skip
        found = np.concatenate([lowest, highest])
        return np.asarray(found[np.isfinite(found).all(axis=1)])

    def shadow(self, design: Design, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the ends of links on the floor, (K, 2), at those of given poses in reach."""
        floor = [k for k in range(3) if k != self.space.mechanism.vertical]
        margin, lci = self.field(design, poses)
        kept = (margin >= 0) & (lci >= self.space.settings.min_lci)
        return np.asarray(self.probe(design, poses[:, kept]).segments.reshape(-1, 3)[:, floor])

    def scratch(self) -> NDArray[np.float64]:
        """Return block buffers for one call of an entry, at the beginning of a line of the cache.

        Vectors that straddle two lines take a third more time.
        """
        rows = self.recipe.scratch_rows
        room = np.empty(rows * sweep.PITCH + _LINE)
        first = -(room.ctypes.data // room.itemsize) % _LINE
        return room[first : first + rows * sweep.PITCH].reshape(rows, sweep.PITCH)
