"""Aspects: the connected singularity-free regions of a workspace (Borrel and Liegeois, 1986).

Within a working mode the reachable poses split where the determinant of the inverse Jacobian
changes sign, at a forward or a constraint singularity. Regions of one sign are separated on a grid
of cells; a pose belongs to the region of its sign that is nearest in the grid.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.evaluator import Evaluator
from pmopt.analysis.sampling.tallies import Tallies
from pmopt.compiler.machine_code import Program
from pmopt.compiler.program_text import ENTRIES
from pmopt.mechanisms.mechanism import Vector
from pmopt.numerics import sequences
from pmopt.numerics.bins import bins_of
from pmopt.numerics.matrices import determinant, inverse, singular_values

#: Cells along each axis by number of pose coordinates: some hundred thousand cells in all.
CELLS = {1: 4096, 2: 512, 3: 72, 4: 26, 5: 14, 6: 9}
#: A pose farther than this many cells from every region of its sign belongs to none.
_NEAR = 2.5
_CHUNK = 1 << 16


def determinants(evaluator: Evaluator, design: Design, poses: NDArray[np.float64]) -> Vector:
    """Return the determinant of the inverse Jacobian over the product of its rows' norms.

    It lies in [-1, 1]; 0 at a forward or constraint singularity, NaN nowhere.
    """
    found = np.empty(poses.shape[1])
    for start in range(0, poses.shape[1], _CHUNK):
        entries = evaluator.probe(design, poses[:, start : start + _CHUNK]).entries
        norms = np.linalg.norm(entries, axis=2, keepdims=True)
        scaled = entries / np.where(norms > 0, norms, 1.0)
        found[start : start + _CHUNK] = determinant(np.nan_to_num(scaled))
    return found


def determinants_along(
    evaluator: Evaluator,
    design: Design,
    poses: NDArray[np.float64],
    axes: int | NDArray[np.int64],
    values: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the determinants at poses (d, m) of which one coordinate has other values.

    Parameters
    ----------
    evaluator : Evaluator
    design : Design
    poses : (d, m) float64
    axes : int or (m,) int64
        Which coordinate, of all or of each.
    values : (.., m) float64

    Returns
    -------
    dets : (.., m) float64
    """
    several = values.reshape(-1, values.shape[-1])
    places = np.repeat(poses[:, None, :], len(several), axis=1)
    places[axes, :, np.arange(poses.shape[1])] = several.T
    dets = determinants(evaluator, design, places.reshape(len(poses), -1))
    return dets.reshape(values.shape)


@dataclass(frozen=True)
class AspectMap:
    """Labels of the cells of a design's box.

    Attributes
    ----------
    lower, step : (d,) float64
    cells : int
    labels : (cells,) * d int32
        0 where nothing is reachable; aspects from 1, the largest first.
    signs : tuple of int
        Sign of the determinant in each aspect.
    counts : tuple of int
        Cells of each aspect.
    nearest : dict
        By sign, the label of the nearest cell of that sign, 0 where none is near.
    """

    lower: Vector
    step: Vector
    cells: int
    labels: NDArray[np.int32]
    signs: tuple[int, ...]
    counts: tuple[int, ...]
    nearest: Mapping[int, NDArray[np.int32]]

    def of(self, poses: NDArray[np.float64], dets: Vector) -> NDArray[np.int32]:
        """Return the aspect of each pose, 0 where it is near none."""
        index = np.floor((poses - self.lower[:, None]) / self.step[:, None]).astype(np.int64)
        place = tuple(np.clip(index, 0, self.cells - 1))
        return np.asarray(np.where(dets > 0, self.nearest[1][place], self.nearest[-1][place]))


def map_aspects(evaluator: Evaluator, design: Design, cells: int | None = None) -> AspectMap:
    """Label the aspects of a design on a grid.

    Parameters
    ----------
    evaluator : Evaluator
    design : Design
        Its box must not be empty.
    cells : int, optional
        Along each axis; default: see :data:`CELLS`.
    """
    from scipy import ndimage

    dimension = len(design.width)
    cells = cells or CELLS[dimension]
    step = design.width / cells
    axes = [low + s * (np.arange(cells) + 0.5)
            for low, s in zip(design.lower, step, strict=True)]  # fmt: skip
    poses = np.stack([m.ravel() for m in np.meshgrid(*axes, indexing="ij")])
    margin, lci = evaluator.field(design, poses)
    shape = (cells,) * dimension
    inside = ((margin >= 0) & (lci >= evaluator.space.settings.min_lci)).reshape(shape)
    sign = np.zeros(shape, dtype=np.int8)
    sign[inside] = np.where(determinants(evaluator, design, poses[:, inside.ravel()]) > 0, 1, -1)
    parts: list[tuple[int, int, int]] = []
    found = {}
    for s in (1, -1):
        raw, count = ndimage.label(sign == s)
        found[s] = raw
        sizes = np.bincount(raw.ravel(), minlength=count + 1)
        parts += [(int(sizes[k]), s, k) for k in range(1, count + 1)]
    parts.sort(key=lambda part: -part[0])
    labels = np.zeros(shape, dtype=np.int32)
    renamed = {s: np.zeros(raw.max() + 1, dtype=np.int32) for s, raw in found.items()}
    for number, (_, s, k) in enumerate(parts, start=1):
        renamed[s][k] = number
    nearest = {}
    for s, raw in found.items():
        own = renamed[s][raw]
        labels += own
        if not own.any():
            nearest[s] = own
            continue
        distance, where = ndimage.distance_transform_edt(own == 0, return_indices=True)
        nearest[s] = np.where(distance <= _NEAR, own[tuple(where)], 0).astype(np.int32)
    return AspectMap(
        design.lower, step, cells, labels,
        tuple(s for _, s, _ in parts), tuple(size for size, _, _ in parts), nearest,
    )  # fmt: skip


@dataclass(eq=False)
class FieldEvaluator(Evaluator):
    """Finds what the compiled sweep does not know: the home aspect, the index of a block.

    Margins and indices are those of :meth:`field`; a point costs some hundred times more.
    """

    slowness = 16
    _maps: dict[tuple[float, ...], tuple[AspectMap, int]] = dataclasses.field(
        default_factory=dict, init=False, repr=False
    )

    @property
    def compiled(self) -> Evaluator:
        """The evaluator of all that can be reached."""
        return Evaluator(self.space, self.threads, self.program, self.sweeping, self.recipe)

    def home(self, design: Design) -> tuple[AspectMap, int]:
        """Return the map of a design's aspects and the label of the home pose's, 0 for none."""
        key = (*design.constants, *design.lower.tolist(), *design.width.tolist())
        home = self._maps.get(key)
        if home is None:
            found = map_aspects(self.compiled, design)
            pose = np.array([list(self.space.mechanism.home(design.parameters).values())]).T
            margin, _ = self.compiled.field(design, pose)
            label = 0
            if margin[0] >= 0:
                label = int(found.of(pose, determinants(self, design, pose))[0])
            home = found, label
            self._maps = {key: home}  # other threads may be at other designs
        return home

    @property
    def sampling_kernels(self) -> dict[Program, tuple[str, ...]]:
        """Of :attr:`kernels`, what sampling calls."""
        return {self.program: ENTRIES[1:]}

    def field(self, design: Design, poses: NDArray[np.float64]) -> tuple[Vector, Vector]:
        """Return margin and LCI of the block; outside the home aspect the margin is negative."""
        margin, lci = super().field(design, poses)
        if self.space.settings.block is not None:
            lci = self._block_index(design, poses, margin)
        if design.box_volume == 0 or self.space.settings.aspect is None:
            return margin, lci
        found, label = self.home(design)
        inside = np.flatnonzero(margin >= 0)
        member = np.zeros(len(margin), dtype=bool)
        some = poses[:, inside]
        member[inside] = found.of(some, determinants(self, design, some)) == label
        if label == 0:
            member[:] = False
        return np.where(member, margin, -np.abs(margin) - 1e-12), lci

    def locate(
        self, design: Design, poses: NDArray[np.float64]
    ) -> tuple[Vector, NDArray[np.float64]]:
        """Return slack and place; see :meth:`Evaluator.locate`.

        At the home aspect's boundary the determinant is 0, and with it the slack.
        """
        slack, places = super().locate(design, poses)
        if design.box_volume == 0 or self.space.settings.aspect is None:
            return slack, places
        found, label = self.home(design)
        dets = determinants(self, design, poses)
        member = (found.of(poses, dets) == label) & (label > 0)
        depth = np.abs(dets)
        return np.minimum(slack, np.where(member, depth, -depth - 1e-12)), places

    def _block_index(self, design: Design, poses: NDArray[np.float64], margin: Vector) -> Vector:
        """Return the index of the Jacobian's rows for lengths or for angles, 0 out of reach."""
        wanted = "length" if self.space.settings.block == "translational" else "angle"
        rows = [k for k, c in enumerate(self.space.mechanism.pose) if c.kind == wanted]
        lci = np.zeros(len(margin))
        inside = np.flatnonzero(margin >= 0)
        for start in range(0, len(inside), _CHUNK):
            part = inside[start : start + _CHUNK]
            entries = self.probe(design, poses[:, part]).entries
            entries = entries / np.abs(entries).max(axis=(1, 2), keepdims=True)
            regular = determinant(entries) != 0
            jacobian = inverse(entries[regular])[:, rows]
            values = singular_values(jacobian)
            if self.space.settings.norm == "2":
                index = values[:, -1] / values[:, 0]
            else:
                index = 1 / np.sqrt((values**2).sum(axis=1) * (1 / values**2).sum(axis=1))
            lci[part[regular]] = index
        return lci

    def outline(
        self, design: Design, points: sequences.Sequence, first: int, last: int
    ) -> NDArray[np.float64]:
        """Return the ends of links on the floor; see :meth:`Evaluator.outline`."""
        return self.shadow(design, self.points(design, points, first, last))

    def tally(
        self,
        designs: Sequence[Design],
        points: sequences.Sequence,
        first: int,
        last: int,
        bins: int = 0,
    ) -> Tallies:
        """Sum over points; see :meth:`Evaluator.tally`."""
        shape = (len(designs), points.replicates)
        reachable, within, total, best = (np.zeros(shape) for _ in range(4))
        smallest, largest = np.full(shape, np.inf), np.full(shape, -np.inf)
        above = np.zeros((*shape, len(self.edges)))
        histogram = np.zeros((*shape, bins))
        for place in np.ndindex(*shape):
            design = designs[place[0]]
            if design.box_volume == 0:
                best[place] = -np.inf
                continue
            one = slice(place[1], place[1] + 1)
            alone = points._replace(
                start=points.start[one], high=points.high[one], low=points.low[one]
            )
            margin, lci = self.field(design, self.points(design, alone, first, last))
            best[place] = margin.max()
            inside = lci[margin >= 0]
            kept = inside[inside >= self.space.settings.min_lci]
            within[place], reachable[place], total[place] = len(inside), len(kept), kept.sum()
            if len(inside):
                largest[place] = inside.max()
            if len(kept):
                smallest[place] = kept.min()
            above[place] = [(kept >= edge).sum() for edge in self.edges]
            if bins:
                histogram[place] = np.bincount(bins_of(kept), minlength=bins)
        box = np.array([d.box_volume for d in designs])
        return Tallies(
            last - first, box, reachable, within, reachable.copy(), total, smallest, largest, best,
            above, histogram,
        )  # fmt: skip
