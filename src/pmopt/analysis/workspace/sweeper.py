"""From designs to tallies: the compiled sweep under settings, over chunks and threads."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.record import Subject
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.compiler.machine_code import Program
from pmopt.compiler.program_text import ENTRIES, PLACE, Checks, Recipe, specialise
from pmopt.compiler.records import flat, size
from pmopt.errors import InputError
from pmopt.execution.threads import default_threads, ordered_map
from pmopt.kernels import sweep
from pmopt.kernels.vectors import Vec3
from pmopt.mechanisms.mechanism import (
    Coordinate,
    JacobianKind,
    Mechanism,
    Parameters,
    Ranges,
    Vector,
)
from pmopt.numerics import sequences
from pmopt.numerics.elementary import cos, exp, log
from pmopt.numerics.matrices import product
from pmopt.seeds import seed_sequence

if TYPE_CHECKING:
    from pmopt.execution.cluster import Cluster

#: Bins of the LCI histogram; see :func:`pmopt.kernels.sweep.bin_of`.
BINS = sweep.BINS
#: Points of one chunk, all replicates together: some milliseconds of work.
CHUNK = 1 << 18
#: Chunks of one block: what is summed by itself and may be kept, or computed elsewhere.
BLOCK_CHUNKS = 16

Notify = Callable[[str], None]
#: Called with the points of a replicate done so far.
Done = Callable[[int], None]

#: Entries that the search for the extremes of the index calls.
_SEARCHING = ("field", "points", "probe")
#: Where the tool point is in the base frame; limits can be set on it where there is a tool.
TOOL = tuple(Coordinate(f"tool_{axis}", "length", f"{axis} of the tool point") for axis in "xyz")
#: The characteristic length that is best is sought on this many points, within this factor.
#: Numbers in a line of the cache.
_LINE = 8
_STRIPS = 4096
_FEW = 4096
_LENGTH_POINTS = 1 << 13
_LENGTH_FACTOR = 30.0
#: A domain and the reach are apart if more than this share of their ends' size is between them.
_TOUCHING = 1e-9


@dataclass(frozen=True)
class Design:
    """One design ready for the sweep: kernel constants and the box its points fill.

    ``cut`` (d, 2) tells which faces of the box, lower and upper, cut off what can be reached.
    ``given`` is the domain as it was given, the box's own ends in the place of infinite ones and of
    coordinates without; ``void`` says that no pose in reach is in the domain, proven.
    """

    parameters: Parameters
    length: float
    limits: Ranges
    lower: Vector
    width: Vector
    cut: NDArray[np.bool_]
    constants: list[float]
    given: Ranges = field(default_factory=dict)
    void: bool = False

    @property
    def box_volume(self) -> float:
        """Volume of the box; 0 where nothing can be reached."""
        return float(np.prod(self.width))


@dataclass(frozen=True)
class Facts:
    """What the kernel and the skeleton tell of N poses.

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


@dataclass
class Tallies:
    """Sums over sample points, the leading axes designs (where there are several) and replicates.

    Attributes
    ----------
    points : int
        Points of each replicate.
    box : (...,) float
        Box volume of each design.
    reachable, within, hits, total, smallest, largest, margin : (..., R)
        See the columns of :mod:`pmopt.kernels.sweep`. Points on lines count with their weights,
        but for ``hits``.
    above : (..., R, e) float64
        Points with an index of at least each inner region edge.
    histogram : (..., R, BINS) float64
    """

    points: int
    box: NDArray[np.float64]
    reachable: NDArray[np.float64]
    within: NDArray[np.float64]
    hits: NDArray[np.float64]
    total: NDArray[np.float64]
    smallest: NDArray[np.float64]
    largest: NDArray[np.float64]
    margin: NDArray[np.float64]
    above: NDArray[np.float64]
    histogram: NDArray[np.float64]

    def add(self, other: Tallies) -> None:
        """Add the tallies of further points; the order of additions fixes the last digits."""
        self.points += other.points
        self.reachable += other.reachable
        self.within += other.within
        self.hits += other.hits
        self.total += other.total
        np.minimum(self.smallest, other.smallest, out=self.smallest)
        np.maximum(self.largest, other.largest, out=self.largest)
        np.maximum(self.margin, other.margin, out=self.margin)
        self.above += other.above
        self.histogram += other.histogram


class Sweeper:
    """Samples designs of one mechanism under one set of settings.

    Parameters
    ----------
    mechanism : Mechanism
    settings : WorkspaceSettings
    seed : int
    threads : int, optional
        Default: see :func:`pmopt.execution.threads.default_threads`. Results do not depend on it.
    notify : callable, optional
        Receives a line when kernels have to be compiled.

    Raises
    ------
    InputError
        For names in the settings that the mechanism does not have.
    """

    #: How many times more a pose costs than in the compiled sweep, roughly.
    slowness = 1

    def __init__(
        self,
        mechanism: Mechanism,
        settings: WorkspaceSettings,
        seed: int = 1,
        threads: int | None = None,
        notify: Notify | None = None,
        where: str = "workspace",
    ) -> None:
        self.mechanism = mechanism
        self.settings = settings
        self.seed = seed
        self.purpose = "workspace samples"
        #: Where the blocks of a workspace are summed, if not here.
        self.cluster: Cluster | None = None
        self._sequences: dict[tuple[int, str, int], sequences.Sequence] = {}
        self.threads = threads or default_threads()
        self.working_mode = mechanism.check_mode(settings.working_mode, f"{where}: working_mode")
        self.domain = mechanism.check_ranges(settings.domain, mechanism.pose, f"{where}: domain")
        tool = TOOL if settings.tool is not None else ()
        self.limits = mechanism.check_ranges(
            settings.limits, (*mechanism.limited, *tool), f"{where}: limits"
        )
        if settings.cone_angle is not None and not mechanism.cones:
            raise InputError(f"{where}: cone_angle: {mechanism.name} has no passive U or S joints")
        self.jacobian: JacobianKind = settings.jacobian or mechanism.default_jacobian
        if settings.characteristic_length is not None:
            self.jacobian = "homogenized"
        self.edges = np.array(settings.regions[1:-1], dtype=float)
        checks = {
            "clearance": settings.link_diameter,
            "cone": settings.cone_angle,
            "tool": settings.tool,
        }
        self._checks = tuple(name for name, given in checks.items() if given is not None)
        if settings.sampler == "lines" and mechanism.line is None:
            raise InputError(
                f"{where}: sampler=lines is not offered by {mechanism.name}, "
                "allowed: r-sequence, sobol, monte-carlo"
            )
        self._recipe = Recipe(
            mechanism.kernel,
            mechanism.skeleton,
            len(mechanism.pose),
            mechanism.form_of_constants,
            len(mechanism.joints),
            settings.norm,
            mechanism.segments,
            mechanism.spokes,
            len(mechanism.cones),
            self._checks,
            switches=tuple(mechanism.switches(self.limits).items()),
        )
        said = notify is None

        def on_compile() -> None:
            nonlocal said
            if not said and notify is not None:
                said = True  # plain kernels and those on lines are one line
                notify(f"compiling the kernels of {mechanism.name}, once: some seconds")

        self._kernels = specialise(self._recipe, on_compile)
        self._sweep = self._kernels
        if settings.sampler == "lines":
            lines = self._recipe._replace(
                line=mechanism.line, line_axis=mechanism.line_axis, line_parts=mechanism.line_parts
            )
            self._sweep = specialise(lines, on_compile)

    def subject(self, design: Design) -> Subject:
        """Return what results of a design are of."""
        return Subject(
            mechanism=self.mechanism.name,
            params=dict(design.parameters),
            length_unit=self.mechanism.length_unit,
            working_mode=self.working_mode,
            box=dict(design.given),
            limits=dict(design.limits),
        )

    def design(self, parameters: Parameters) -> Design:
        """Return a design ready to be swept, its box cut to the domain."""
        mechanism = self.mechanism
        limits = {**mechanism.default_limits(parameters), **self.limits}
        lower, upper = mechanism.reach_box(parameters, limits)
        whole = np.stack([lower, upper], axis=1)
        domain = {**mechanism.default_domain(parameters), **self.domain}
        for i, coordinate in enumerate(mechanism.pose):
            low, high = domain.get(coordinate.name, (-math.inf, math.inf))
            lower[i], upper[i] = max(lower[i], low), min(upper[i], high)
        cut = np.stack([lower, upper], axis=1) != whole
        asked = {
            c.name: _as_given(self.domain.get(c.name), domain.get(c.name), low, high)
            for c, low, high in zip(mechanism.pose, lower.tolist(), upper.tolist(), strict=True)
        }
        # What only touches the reach, to rounding, is not proven to be out of it.
        slack = _TOUCHING * np.maximum(np.abs(lower), np.abs(upper))
        void = bool((lower - upper > slack).any())
        width = upper - lower
        if not np.all(width > 0):
            width = np.zeros_like(width)
        length = 1.0
        if self.jacobian == "homogenized":
            given = self.settings.characteristic_length
            length = (
                float(given)
                if isinstance(given, int | float)
                else mechanism.characteristic_length(parameters)
            )

        def ready(length: float) -> Design:
            own = mechanism.kernel_constants(parameters, self.working_mode, length, limits)
            constants = flat(own)
            if self._checks:
                constants += flat(self._check_constants())
            return Design(parameters, length, limits, lower, width, cut, constants, asked, void)

        design = ready(length)
        if self.settings.characteristic_length == "optimal" and design.box_volume > 0:
            return ready(self._best_length(ready, length))
        return design

    def nothing(self, parameters: Parameters) -> Design:
        """Return a design with an empty box, for one that can not be made ready."""
        axes = len(self.mechanism.pose)
        count = self.mechanism.constant_count
        count += size(Checks) if self._checks else 0
        return Design(
            parameters, 1.0, {}, np.zeros(axes), np.zeros(axes), np.zeros((axes, 2), dtype=bool),
            [0.0] * count,
        )  # fmt: skip

    def _check_constants(self) -> Checks:
        """Return what the margin's checks compare with; see pmopt.compiler.program_text."""
        settings = self.settings
        link = settings.link_diameter or 0.0
        half_sum = (link + (settings.platform_diameter or link)) / 2
        ends = [self.limits.get(c.name, (-math.inf, math.inf)) for c in TOOL]
        return Checks(
            limbs2=link * link,
            platform2=half_sum * half_sum,
            cosine=-2.0 if settings.cone_angle is None else cos(settings.cone_angle),
            tool=Vec3(*(settings.tool or (0.0, 0.0, 0.0))),
            low=Vec3(*(low for low, _ in ends)),
            high=Vec3(*(high for _, high in ends)),
        )

    def _best_length(self, ready: Callable[[float], Design], about: float) -> float:
        """Return the characteristic length with the largest GCI over a fixed sample.

        The mean of the inverse condition number stands for the condition number, whose mean over
        a workspace that reaches a singularity does not exist.
        """
        from scipy.optimize import minimize_scalar

        points = sequences.make_sequence(
            "r-sequence", len(self.mechanism.pose), 1, seed_sequence(self.seed, "length samples")
        )

        def loss(log_length: float) -> float:
            tallies = self.tally([ready(exp(log_length))], points, 0, _LENGTH_POINTS)
            return -float(tallies.total[0, 0]) / max(float(tallies.within[0, 0]), 1.0)

        middle, half = log(about), log(_LENGTH_FACTOR)
        found = minimize_scalar(loss, bounds=(middle - half, middle + half), method="bounded",
                                options={"xatol": 1e-6})  # fmt: skip
        return exp(found.x)

    @property
    def kernels(self) -> dict[Program, tuple[str, ...]]:
        """The compiled texts of this sweeper and the entries it may call."""
        found: dict[Program, tuple[str, ...]] = {self._sweep: ("sweep",)}
        found[self._kernels] = (*found.get(self._kernels, ()), *ENTRIES[1:])
        return found

    @property
    def sampling_kernels(self) -> dict[Program, tuple[str, ...]]:
        """Of :attr:`kernels`, what sampling calls."""
        return {self._sweep: ("sweep",)}

    @property
    def measuring_kernels(self) -> dict[Program, tuple[str, ...]]:
        """Of :attr:`kernels`, what sampling and the search for extremes call."""
        found = self.sampling_kernels
        called = dict.fromkeys((*found.get(self._kernels, ()), *_SEARCHING))
        return found | {self._kernels: tuple(called)}

    def for_purpose(self, purpose: str) -> Sweeper:
        """Return a sweeper with the same settings and independent sample points."""
        other = copy.copy(self)
        other.purpose = purpose
        return other

    def sequence(self, replicates: int) -> sequences.Sequence:
        """Return the sample points shared by all designs of a run."""
        sampler = self.settings.sampler
        key = self.seed, self.purpose, replicates
        if key not in self._sequences:
            points = sequences.make_sequence(
                "sobol" if sampler == "lines" else sampler,
                len(self.mechanism.pose),
                replicates,
                seed_sequence(self.seed, self.purpose),
            )
            if sampler == "lines":
                points = points.with_last(self.mechanism.line_axis)
            self._sequences[key] = points
        return self._sequences[key]

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
        statistics = np.empty((count, replicates, sweep.STATISTICS))
        above = np.empty((count, replicates, len(self.edges)))
        histogram = np.empty((count, replicates, bins))
        self._sweep.sweep(
            *points,
            first,
            last,
            np.array([d.constants for d in designs]),
            np.array([d.lower for d in designs]),
            np.array([d.width for d in designs]),
            self.settings.min_lci,
            self.edges,
            statistics,
            above,
            histogram,
            self._scratch(),
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

    def tally_population(
        self, designs: Sequence[Design], points: sequences.Sequence, count: int
    ) -> Tallies:
        """Sweep ``count`` points a replicate for a whole population, designs over threads."""
        slices = max(1, min(len(designs), 4 * self.threads))
        bounds = [i * len(designs) // slices for i in range(slices + 1)]
        parts = [designs[a:b] for a, b in zip(bounds, bounds[1:], strict=False)]
        ranges = list(chunk_ranges(0, count, points.replicates))
        swept = ordered_map(
            lambda work: self.tally(work[0], points, *work[1]),
            ((part, span) for part in parts for span in ranges),
            self.threads,
        )
        tallies = []
        for _ in parts:
            whole = next(swept)
            for _ in ranges[1:]:
                whole.add(next(swept))
            tallies.append(whole)
        arrays: list[Any] = [
            np.concatenate([getattr(t, name) for t in tallies])
            for name in list(Tallies.__dataclass_fields__)[1:]
        ]
        return Tallies(count, *arrays)

    def stream(
        self, design: Design, points: sequences.Sequence, ranges: Iterable[tuple[int, int]]
    ) -> Iterator[Tallies]:
        """Yield the tallies of ranges of points in order, computed on all threads."""
        return ordered_map(
            lambda r: self.tally([design], points, r[0], r[1], BINS), ranges, self.threads
        )

    def blocks(
        self, design: Design, points: sequences.Sequence, first: int, last: int, done: Done
    ) -> Iterator[Tallies]:
        """Yield the tallies of the blocks of a range of points in order, on all threads.

        A block's tallies are those of its chunks added in order, wherever they are computed.
        ``done`` is told how many points are, after every chunk.
        """
        replicates = points.replicates
        chunks = self.stream(design, points, chunk_ranges(first, last, replicates))
        for start, stop in block_ranges(first, last, replicates):
            block = None
            for _, end in chunk_ranges(start, stop, replicates):
                part = next(chunks)
                if block is None:
                    block = part
                else:
                    block.add(part)
                done(end)
            assert block is not None  # every range holds a point
            yield block

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
            self._kernels.field(
                np.ascontiguousarray(poses[:, part]), constants, margin[part], lci[part],
                self._scratch(),
            )  # fmt: skip

        for _ in ordered_map(evaluate, range(0, size, step), self.threads):
            pass
        return margin, lci

    def probe(self, design: Design, poses: NDArray[np.float64]) -> Facts:
        """Return what kernel and skeleton tell of given poses, shape (d, N)."""
        mechanism = self.mechanism
        n, segments, size = len(mechanism.joints), len(mechanism.segments), poses.shape[1]
        facts = np.empty((1 + n * n + PLACE + 6 * segments + len(mechanism.cones), size))
        constants = np.array(design.constants)
        step = CHUNK // 16

        def evaluate(start: int) -> None:
            part = slice(start, min(start + step, size))
            found = np.empty((len(facts), part.stop - start))
            self._kernels.probe(np.ascontiguousarray(poses[:, part]), constants, found)
            facts[:, part] = found

        for _ in ordered_map(evaluate, range(0, size, step), self.threads):
            pass
        place = 1 + n * n
        position = facts[place : place + 3].T
        rotation = facts[place + 3 : place + PLACE].T.reshape(size, 3, 3)
        ends = facts[place + PLACE : place + PLACE + 6 * segments].T.reshape(size, segments, 2, 3)
        tool = position + product(rotation, np.array(self.settings.tool or (0.0, 0.0, 0.0)))
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
        tool = np.array(self.settings.tool or (0.0, 0.0, 0.0))
        self._kernels.locate(
            np.ascontiguousarray(poses), constants, tool, margin, places, self._scratch()
        )
        if self.settings.min_lci > 0:
            margin = np.minimum(margin, self.field(design, poses)[1] - self.settings.min_lci)
        return margin, places

    def points(
        self, design: Design, points: sequences.Sequence, first: int, last: int
    ) -> NDArray[np.float64]:
        """Return the points ``first .. last - 1`` of the first replicate, shape (d, N)."""
        poses = np.empty((len(design.width), last - first))
        self._kernels.points(
            *points, first, last, design.lower, design.width, poses, self._scratch()
        )
        return poses

    def outline(
        self, design: Design, points: sequences.Sequence, first: int, last: int
    ) -> NDArray[np.float64]:
        """Return points on the floor whose convex hull is that of all links at sample poses.

        Of the points ``first .. last - 1`` of the first replicate those that are reachable, shape
        (K, 2); the least and the greatest in each of many strips bound the hull.
        """
        floor = [k for k in range(3) if k != self.mechanism.vertical]
        some = self.shadow(design, self.points(design, points, first, min(last, first + _FEW)))
        if len(some) == 0 or self.settings.min_lci > 0:
            return self.shadow(design, self.points(design, points, first, last))
        # A few poses tell about how far the strips must reach.
        reach = max(1.2 * float(np.ptp(some[:, 0])), 1e-300)
        edge = float(some[:, 0].min()) - reach / 12
        lowest = np.full((_STRIPS + 1, 2), np.inf)
        highest = np.full((_STRIPS + 1, 2), -np.inf)
        self._kernels.outline(
            *points, first, last, np.array(design.constants), design.lower, design.width,
            *floor, edge, reach / _STRIPS, lowest, highest, self._scratch(),
        )  # fmt: skip
        found = np.concatenate([lowest, highest])
        return np.asarray(found[np.isfinite(found).all(axis=1)])

    def shadow(self, design: Design, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the ends of links on the floor, (K, 2), at those of given poses in reach."""
        floor = [k for k in range(3) if k != self.mechanism.vertical]
        margin, lci = self.field(design, poses)
        kept = (margin >= 0) & (lci >= self.settings.min_lci)
        return np.asarray(self.probe(design, poses[:, kept]).segments.reshape(-1, 3)[:, floor])

    def _scratch(self) -> NDArray[np.float64]:
        """Return block buffers for one call of an entry, at the beginning of a line of the cache.

        Vectors that straddle two lines take a third more time.
        """
        rows = self._recipe.scratch_rows
        room = np.empty(rows * sweep.PITCH + _LINE)
        first = -(room.ctypes.data // room.itemsize) % _LINE
        return room[first : first + rows * sweep.PITCH].reshape(rows, sweep.PITCH)


def _as_given(
    given: tuple[float, float] | None,
    searched: tuple[float, float] | None,
    low: float,
    high: float,
) -> tuple[float, float]:
    """Return the domain of a coordinate: as given, else by default, else what can be reached."""
    if given is None:
        if low <= high or searched is None:
            return low, high
        given = searched
    return (given[0] if math.isfinite(given[0]) else low,
            given[1] if math.isfinite(given[1]) else high)  # fmt: skip


def chunk_ranges(first: int, last: int, replicates: int) -> Iterator[tuple[int, int]]:
    """Split a range of point indices at fixed multiples, whatever the number of threads."""
    return _split(first, last, _chunk_length(replicates))


def block_ranges(first: int, last: int, replicates: int) -> Iterator[tuple[int, int]]:
    """Split a range of point indices into blocks of whole chunks, at fixed multiples."""
    return _split(first, last, block_length(replicates))


def block_length(replicates: int) -> int:
    """Return the points of each replicate in a whole block."""
    return BLOCK_CHUNKS * _chunk_length(replicates)


def _chunk_length(replicates: int) -> int:
    return max(sequences.BLOCK, CHUNK // replicates // sequences.BLOCK * sequences.BLOCK)


def _split(first: int, last: int, length: int) -> Iterator[tuple[int, int]]:
    start = first
    while start < last:
        stop = min(last, (start // length + 1) * length)
        yield start, stop
        start = stop


def check_grid(cells: int, dimension: int) -> None:
    """Refuse a grid with more points than an index can count.

    Raises
    ------
    InputError
    """
    if cells**dimension >= 1 << 53:
        raise InputError(f"grid: {cells} cells a axis in {dimension} dimensions are too many")
