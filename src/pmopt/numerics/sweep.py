"""The compiled sweep over sample points: the text that is specialised to a mechanism.

The functions below are plain Python. :mod:`pmopt.numerics.specialise` copies their source,
with a mechanism's kernel and a conditioning function in place of the stubs, into one
self-contained module that is compiled. They hold no lock, allocate nothing (block buffers are
arguments) and never raise: the caller checks its arguments.

Reductions: points are taken in blocks of fixed length in order of their index, so that the sums
of a call depend on its arguments alone. Sums of several calls are added by the caller in order.
"""

import numpy as np

BLOCK = 512

# Columns of the statistics.
REACHABLE = 0  # points inside every limit, with LCI >= min_lci
SUM_LCI = 1
MIN_LCI = 2
MAX_LCI = 3
BEST_MARGIN = 4  # largest margin met while no point had been within the limits
WITHIN = 5  # points inside every limit, whatever their LCI
STATISTICS = 6

TWO_POW_M52 = 1.0 / 4503599627370496.0
TWO_POW_M64 = 1.0 / 18446744073709551616.0


def margin_of(pose, i, constants):
    """Stub: the margin of pose ``i`` of a block, from the mechanism's kernel."""
    raise NotImplementedError


def index_block(pose, count, constants, work, lci):
    """Stub: write the local conditioning indices of ``count`` poses of a block.

    ``work`` is scratch space, a row for each entry of the Jacobian.
    """
    raise NotImplementedError


def facts_of(pose, i, constants):
    """Stub: what ``probe`` writes of pose ``i`` of a block, as a tuple."""
    raise NotImplementedError


#: Stub: coordinates of a pose.
AXES = 0
#: Stub: length of the tuple of ``facts_of``.
FACTS = 0


def unpack(constants):
    """Stub: a row of constants as a tuple, so that the compiler keeps them in registers."""
    raise NotImplementedError


def mix(x):
    """Finalise a 64-bit counter (splitmix64; Steele, Lea and Flood 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def fill(kind, step, start, high, low, cells, first, count, lower, width, pose):
    """Write the points ``first .. first + count - 1`` of one replicate into ``pose`` (d, BLOCK)."""
    dimension = pose.shape[0]
    if kind == 0:  # additive recurrence
        for d in range(dimension):
            base = float(start[d] + np.uint64(first) * step[d]) * TWO_POW_M64
            stride = float(step[d]) * TWO_POW_M64
            row = pose[d]
            lo = lower[d]
            w = width[d]
            for i in range(count):
                u = base + stride * i
                row[i] = lo + w * (u - np.floor(u))
    elif kind == 1:  # scrambled Sobol'
        for d in range(dimension):
            base = np.uint64(0)
            bits = np.uint64(first)
            j = 0
            while bits != np.uint64(0):
                if bits & np.uint64(1):
                    base ^= high[d, j]
                bits >>= np.uint64(1)
                j += 1
            row = pose[d]
            table = low[d]
            lo = lower[d]
            w = width[d]
            for i in range(count):
                row[i] = lo + w * (np.int64(base ^ table[i]) + 0.5) * TWO_POW_M52
    elif kind == 2:  # Monte Carlo
        key = start[0]
        golden = np.uint64(0x9E3779B97F4A7C15)
        for d in range(dimension):
            base = np.uint64(first) * np.uint64(dimension) + np.uint64(d)
            stride = np.uint64(dimension)
            row = pose[d]
            lo = lower[d]
            w = width[d]
            for i in range(count):
                bits = mix(key + (base + stride * np.uint64(i)) * golden)
                row[i] = lo + w * (np.int64(bits >> np.uint64(12)) + 0.5) * TWO_POW_M52
    else:  # midpoint grid, last coordinate fastest
        stride = 1
        for back in range(dimension):
            d = dimension - 1 - back
            row = pose[d]
            lo = lower[d]
            w = width[d] / cells
            cell = (first // stride) % cells
            within = first % stride
            for i in range(count):
                row[i] = lo + w * (cell + 0.5)
                within += 1
                if within == stride:
                    within = 0
                    cell += 1
                    if cell == cells:
                        cell = 0
            stride *= cells


def sweep(
    kind, step, start, high, low, cells, first, last, constants, lower, width, min_lci, edges,
    statistics, region_counts, histogram, scratch,
):  # fmt: skip
    """Sum over the points ``first .. last - 1`` of every replicate, for every design.

    Parameters
    ----------
    kind, step, start, high, low, cells
        A :class:`pmopt.numerics.sequences.Sequence`.
    first, last : int
        Range of point indices within each replicate; ``first`` a multiple of BLOCK.
    constants : (D, c) float64
        Kernel constants, a row a design.
    lower, width : (D, d) float64
        Box of each design.
    min_lci : float
        Points with a smaller index do not count.
    edges : (e,) float64
        Inner edges of the dexterity regions, ascending.
    statistics : (D, R, STATISTICS) float64
    region_counts : (D, R, e) int64
        Points with an index of at least the edge.
    histogram : (D, R, b) int64
        Counts in b equal bins of [0, 1]; b = 0 for none.
    scratch : (rows, BLOCK) float64
        Overwritten; see ``Recipe.scratch_rows``.
    """
    bins = histogram.shape[2]
    # At known places, so that the compiler sees that nothing overlaps.
    pose = scratch[:AXES]
    margin = scratch[AXES]
    lci = scratch[AXES + 1]
    work = scratch[AXES + 2 :]
    for design in range(constants.shape[0]):
        k = unpack(constants[design])
        for replicate in range(start.shape[0]):
            reachable = 0
            within = 0
            total = 0.0
            smallest = np.inf
            largest = -np.inf
            best = -np.inf
            counts = region_counts[design, replicate]
            tally = histogram[design, replicate]
            counts[:] = 0
            tally[:] = 0
            for block in range(first, last, BLOCK):
                count = min(BLOCK, last - block)
                fill(
                    kind, step, start[replicate], high[replicate], low[replicate], cells,
                    block, count, lower[design], width[design], pose,
                )  # fmt: skip
                for i in range(count):
                    margin[i] = margin_of(pose, i, k)
                kept = 0
                for i in range(count):
                    for d in range(AXES):
                        pose[d, kept] = pose[d, i]
                    if margin[i] >= 0.0:
                        kept += 1
                if kept == 0:
                    for i in range(count):
                        if margin[i] > best:
                            best = margin[i]
                    continue
                index_block(pose, kept, k, work, lci)
                within += kept
                if min_lci > 0.0:
                    for i in range(kept):
                        if lci[i] > largest:
                            largest = lci[i]
                    above = 0
                    for i in range(kept):
                        lci[above] = lci[i]
                        if lci[i] >= min_lci:
                            above += 1
                    kept = above
                reachable += kept
                # Four running values: a single one would wait for its own last addition.
                s0 = s1 = s2 = s3 = 0.0
                whole = kept - kept % 4
                for i in range(0, whole, 4):
                    s0 += lci[i]
                    s1 += lci[i + 1]
                    s2 += lci[i + 2]
                    s3 += lci[i + 3]
                for i in range(whole, kept):
                    s0 += lci[i]
                total += (s0 + s1) + (s2 + s3)
                for i in range(kept):
                    smallest = min(smallest, lci[i])
                    largest = max(largest, lci[i])
                for e in range(edges.shape[0]):
                    edge = edges[e]
                    above = 0
                    for i in range(kept):
                        above += 1 if lci[i] >= edge else 0
                    counts[e] += above
                if bins > 0:
                    for i in range(kept):
                        tally[min(bins - 1, int(lci[i] * bins))] += 1
            row = statistics[design, replicate]
            row[REACHABLE] = reachable
            row[SUM_LCI] = total
            row[MIN_LCI] = smallest
            row[MAX_LCI] = largest
            row[BEST_MARGIN] = best
            row[WITHIN] = within


def field(poses, constants, margin, lci, scratch):
    """Evaluate given poses: ``poses`` (d, N), results ``margin`` (N,) and ``lci`` (N,).

    The index is evaluated outside the limits too, where it continues the inside (0 out of reach).
    """
    k = unpack(constants)
    pose = scratch[:AXES]
    work = scratch[AXES:]
    for first in range(0, poses.shape[1], BLOCK):
        count = min(BLOCK, poses.shape[1] - first)
        for d in range(AXES):
            for i in range(count):
                pose[d, i] = poses[d, first + i]
        for i in range(count):
            margin[first + i] = margin_of(pose, i, k)
        index_block(pose, count, k, work, lci[first : first + count])


def points(kind, step, start, high, low, cells, first, last, lower, width, poses, scratch):
    """Write the points ``first .. last - 1`` of the first replicate into ``poses`` (d, N)."""
    pose = scratch[:AXES]
    for block in range(first, last, BLOCK):
        count = min(BLOCK, last - block)
        fill(kind, step, start[0], high[0], low[0], cells, block, count, lower, width, pose)
        for d in range(AXES):
            for i in range(count):
                poses[d, block - first + i] = pose[d, i]


def probe(poses, constants, facts):
    """Write what the kernel and the skeleton tell of given poses, ``facts`` (FACTS, N).

    Rows: margin, entries of the inverse Jacobian, skeleton.
    """
    k = unpack(constants)
    for i in range(poses.shape[1]):
        found = facts_of(poses, i, k)
        for f in range(FACTS):
            facts[f, i] = found[f]
