"""The shape of a workspace: its connected pieces and enclosed voids, counted on a grid of cells.

A cell belongs to a set if the set passes through it, judged by the cell's corners: the index is
continuous, so that a cell with corners at 0.05 and 0.4 holds poses of the region between. Cells
taken by their centres would tear a shell thinner than a cell (low dexterity along the boundary
of the workspace, where the index falls to 0 with the root of the distance) into thousands of bits.
Sets closer to each other than a cell are therefore joined; a second grid shows where that matters.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.cells import label, lattice_points
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.evaluator import Evaluator
from pmopt.errors import InputError
from pmopt.execution.threads import ordered_map

#: Cells per axis by number of pose coordinates, and the most corners of cells in all.
DEFAULT_GRIDS = {1: 4096, 2: 512, 3: 96, 4: 28, 5: 14, 6: 9}
MOST_CORNERS = 1 << 25
#: The same count on this share of the cells shows whether it depends on the resolution.
_COARSER = 2 / 3
#: Smaller pieces and voids than this share of the set's cells are specks, counted apart.
_SPECK_SHARE = 1e-3
_SPECK_CELLS = 8


@dataclass(frozen=True)
class Topology:
    """Pieces and voids of one set of cells.

    Attributes
    ----------
    pieces : int
        Connected pieces (cells that share a face), specks left out.
    piece_shares : tuple of float
        Share of the set's cells in each piece, largest first.
    voids : int
        Connected holes that no path leaves (cells that share a face, edge or corner).
    pockets : int
        Holes that are closed by the domain's boundary only, e.g. a cavity open to its floor.
    specks : int
        Pieces and voids of less than 0.1 % of the set's cells: too small for the grid to resolve.
    confirmed : bool
        Whether a grid of two thirds as many cells an axis counts the same pieces, voids, pockets.
    """

    pieces: int
    piece_shares: tuple[float, ...]
    voids: int
    pockets: int
    specks: int
    confirmed: bool


@dataclass(frozen=True)
class Shape:
    """Topology of the workspace and of each dexterity region."""

    grid: int
    workspace: Topology
    regions: tuple[Topology, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "grid": self.grid,
            "workspace": asdict(self.workspace),
            "regions": [asdict(region) for region in self.regions],
        }


def check_cells(cells: int, dimension: int, where: str) -> int:
    """Return the cells per axis, refused where their corners would not fit into memory.

    Raises
    ------
    InputError
    """
    most = int(MOST_CORNERS ** (1 / dimension)) - 1
    if cells > most:
        raise InputError(
            f"{where}={cells} is not allowed: at most {most} cells an axis with {dimension} "
            "coordinates"
        )
    return cells


def grid_points(design: Design, count: int) -> NDArray[np.float64]:
    """Return the (d, count^d) points of a regular grid over a design's box, its faces included."""
    return lattice_points(np.linspace(design.lower, design.lower + design.width, count, axis=1))


def measure_shape(evaluator: Evaluator, design: Design, cells: int) -> Shape:
    """Count pieces and voids of the workspace and of each dexterity region.

    Parameters
    ----------
    evaluator : Evaluator
    design : Design
    cells : int
        Cells per axis of the design's box.
    """
    fine = _topologies(evaluator, design, cells)
    coarse = _topologies(evaluator, design, max(4, round(cells * _COARSER)))
    whole, *regions = (confirmed(a, b) for a, b in zip(fine, coarse, strict=True))
    return Shape(cells, whole, tuple(regions))


def _counts(topology: Topology) -> tuple[int, int, int]:
    return topology.pieces, topology.voids, topology.pockets


def _topologies(evaluator: Evaluator, design: Design, cells: int) -> list[Topology]:
    if design.box_volume == 0:
        return [Topology(0, (), 0, 0, 0, True)] * (len(evaluator.space.settings.regions))
    shape = (cells + 1,) * len(design.width)
    margin, lci = (
        v.reshape(shape) for v in evaluator.field(design, grid_points(design, cells + 1))
    )
    reached = (margin >= 0.0) & (lci >= evaluator.space.settings.min_lci)
    inside = _any_corner(reached)
    edges = evaluator.space.settings.regions
    sets = [inside]
    for low, high in zip(edges, edges[1:], strict=False):
        above, below = lci >= low, lci < high
        # Cells between a corner below and one above are of the set only if they belong to a piece
        # that some reachable corner shows: out of reach the index may be anything.
        shown = _any_corner(reached & above & below)
        sets.append(_pieces_with(inside & _any_corner(above) & _any_corner(below), shown))
    return list(ordered_map(lambda one: topology_of(one, design.cut), sets, evaluator.threads))


def _any_corner(values: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return for each cell whether it holds for a corner."""
    for axis in range(values.ndim):
        along = np.moveaxis(values, axis, 0)
        values = np.moveaxis(along[:-1] | along[1:], 0, axis)
    return values


def _pieces_with(members: NDArray[np.bool_], shown: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pieces of a set that hold one of some cells."""
    labels, count = label(members)
    keep = np.zeros(count + 1, dtype=bool)
    keep[labels[shown]] = True
    keep[0] = False
    return np.asarray(keep[labels])


def confirmed(fine: Topology, coarse: Topology) -> Topology:
    """Return the finer count, marked by whether the coarser one is the same."""
    return replace(fine, confirmed=_counts(fine) == _counts(coarse))


def topology_of(members: NDArray[np.bool_], cut: NDArray[np.bool_]) -> Topology:
    """Count pieces and holes of a set of cells, not confirmed.

    Parameters
    ----------
    members : (..) bool
    cut : (d, 2) bool
        Which faces of the box cut off what the set is part of.
    """
    total = int(members.sum())
    least = max(_SPECK_CELLS, _SPECK_SHARE * total)
    labels, _ = label(members)
    sizes = np.sort(np.bincount(labels.ravel())[1:])[::-1]
    pieces = sizes[sizes >= least]

    # Holes are pieces of the complement. Beyond a face where reach ends by itself lies the outside,
    # and a corner of the box is taken to; a hole that shows in other faces of the domain is a
    # pocket, one that shows in none is a void.
    outside = np.pad(~members, [(int(not low), int(not high)) for low, high in cut],
                     constant_values=True)  # fmt: skip
    labels, _ = label(outside, diagonal=True)
    holes = np.bincount(labels.ravel())
    holes[0] = 0
    opened = holes.copy()
    for axis, faces in enumerate(cut):
        for end, is_cut in zip((0, -1), faces, strict=True):
            if not is_cut:
                shown = np.take(labels, end, axis).ravel()
                holes[shown] = opened[shown] = 0
    corners = np.meshgrid(*([[0, -1]] * labels.ndim), indexing="ij")
    holes[labels[tuple(corners)]] = opened[labels[tuple(corners)]] = 0
    opened[~_shown_in_faces(labels, len(holes))] = 0
    enclosed = holes - opened
    voids, pockets = enclosed[enclosed >= least], opened[opened >= least]
    specks = (len(sizes) - len(pieces)) + int((holes > 0).sum()) - len(voids) - len(pockets)
    return Topology(
        pieces=len(pieces),
        piece_shares=tuple(float(s) / total for s in pieces),
        voids=len(voids),
        pockets=len(pockets),
        specks=specks,
        confirmed=False,
    )


def _shown_in_faces(labels: NDArray[np.int32], count: int) -> NDArray[np.bool_]:
    """Return which labels show in a face of the box."""
    shown = np.zeros(count, dtype=bool)
    for axis in range(labels.ndim):
        for end in (0, -1):
            shown[np.take(labels, end, axis).ravel()] = True
    return shown
