"""The sweep over sample points, of any mechanism: points, sums and what is drawn.

The functions below are plain Python. :mod:`pmopt.compiler.program_text` copies their source into
texts that are compiled once for all mechanisms. What a mechanism brings is compiled by itself, see
:mod:`pmopt.kernels.pieces`, and called a block of points at a time, by its address; an address of 0
stands for a piece that is not there. Functions hold no lock, allocate nothing (block buffers are
arguments) and never raise: the caller checks its arguments.

A block is rows of PITCH numbers: margins, indices, weights, then room for a piece's own and, last,
the poses, a row a coordinate.

Reductions: points are taken in blocks of fixed length in order of their index, so that the sums
of a call depend on its arguments alone. Sums of several calls are added by the caller in order.
"""

import numpy as np

BLOCK = 512
#: Distance of the rows of a block: rows 4096 bytes apart would share their places in the cache.
PITCH = BLOCK + 72

#: Rows of a block; what is a piece's own begins at WORK.
MARGIN, LCI, WEIGHT, WORK = range(4)
#: Where in a skeleton the ends of segments begin.
PLACE = 12

#: Bits of infinity.
INFINITE = 0x7FF0000000000000

# Columns of the statistics.
REACHABLE = 0  # points inside every limit, with LCI >= min_lci
SUM_LCI = 1
MIN_LCI = 2
MAX_LCI = 3
BEST_MARGIN = 4  # largest margin met while no point had been within the limits
WITHIN = 5  # points inside every limit, whatever their LCI
HITS = 6  # as REACHABLE, but points on lines count as one, whatever their weight
STATISTICS = 7

# Bins of the histogram of LCI: equal parts of octaves, given by the first bits of a float, so that
# they are narrow for what they hold at any scale. Indices are not negative: in that order lie
# their bits too. 128 bins an octave down to 2**-16, then 32 down to 2**-64; the first bin holds
# what is below, 0 among it.
FINE_SHIFT = 45
COARSE_SHIFT = 47
_FINE, _COARSE = 16, 64  # octaves below 1
#: Number of bins.
BINS = 1 + (_COARSE - _FINE) * 32 + _FINE * 128
#: What is taken from the first bits to give a bin; the lines of both meet at 2**-_FINE.
FINE_BASE = 1023 * 128 - BINS
COARSE_BASE = FINE_BASE - (1023 - _FINE) * 96
LAST_BIN = BINS - 1

TWO_POW_M52 = 1.0 / 4503599627370496.0
TWO_POW_M64 = 1.0 / 18446744073709551616.0


def mix(x):
    """Finalise a 64-bit counter (splitmix64; Steele, Lea and Flood 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def sum_of(values, count):
    """Sum values; four running sums: a single one would wait for its own last addition."""
    s0 = s1 = s2 = s3 = 0.0
    whole = count - count % 4
    for i in range(0, whole, 4):
        s0 += values[i]
        s1 += values[i + 1]
        s2 += values[i + 2]
        s3 += values[i + 3]
    for i in range(whole, count):
        s0 += values[i]
    return (s0 + s1) + (s2 + s3)


def bin_of(bits):
    """Return the bin of an index, of its bits."""
    fine = (bits >> FINE_SHIFT) - FINE_BASE
    coarse = (bits >> COARSE_SHIFT) - COARSE_BASE
    return min(max(fine, coarse, 0), LAST_BIN)


def gather(row, chosen, kept, spare):
    """Move the chosen values of a row to its beginning, by way of a spare row."""
    for j in range(kept):
        spare[j] = row[chosen[j]]
    for j in range(kept):
        row[j] = spare[j]


def weight_above(values, weights, edge, count):
    """Sum the weights of values of at least the edge, as in :func:`sum_of`."""
    s0 = s1 = s2 = s3 = 0.0
    whole = count - count % 4
    for i in range(0, whole, 4):
        s0 += weights[i] if values[i] >= edge else 0.0
        s1 += weights[i + 1] if values[i + 1] >= edge else 0.0
        s2 += weights[i + 2] if values[i + 2] >= edge else 0.0
        s3 += weights[i + 3] if values[i + 3] >= edge else 0.0
    for i in range(whole, count):
        s0 += weights[i] if values[i] >= edge else 0.0
    return (s0 + s1) + (s2 + s3)


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
            common = np.uint64(0)
            bits = np.uint64(first)
            j = 0
            while bits != np.uint64(0):
                if bits & np.uint64(1):
                    common ^= high[d, j]
                bits >>= np.uint64(1)
                j += 1
            row = pose[d]
            table = low[d]
            lo = lower[d]
            w = width[d]
            for i in range(count):
                row[i] = lo + w * (np.int64(common ^ table[i]) + 0.5) * TWO_POW_M52
    elif kind == 2:  # Monte Carlo
        key = start[0]
        golden = np.uint64(0x9E3779B97F4A7C15)
        for d in range(dimension):
            counter = np.uint64(first) * np.uint64(dimension) + np.uint64(d)
            apart = np.uint64(dimension)
            row = pose[d]
            lo = lower[d]
            w = width[d]
            for i in range(count):
                mixed = mix(key + (counter + apart * np.uint64(i)) * golden)
                row[i] = lo + w * (np.int64(mixed >> np.uint64(12)) + 0.5) * TWO_POW_M52
    else:  # midpoint grid, last coordinate fastest
        period = 1
        for back in range(dimension):
            d = dimension - 1 - back
            row = pose[d]
            lo = lower[d]
            w = width[d] / cells
            cell = (first // period) % cells
            within = first % period
            for i in range(count):
                row[i] = lo + w * (cell + 0.5)
                within += 1
                if within == period:
                    within = 0
                    cell += 1
                    if cell == cells:
                        cell = 0
            period *= cells


def sweep(
    kind, step, start, high, low, cells, first, last, constants, lower, width, min_lci, edges,
    statistics, region_counts, histogram, scratch, chosen,
    fill, margins, indices, conditions, lines,
):  # fmt: skip
    """Sum over the points ``first .. last - 1`` of every replicate, for every design.

    On lines every point stands for the reachable part of its line: it counts with that part's
    share of the line's length.

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
    region_counts : (D, R, e) float64
        Points with an index of at least the edge.
    histogram : (D, R, b) float64
        Counts in the bins of :func:`bin_of`, b = BINS; b = 0 for none.
    scratch : (rows, PITCH) float64
        Overwritten; see ``Recipe.scratch_rows``.
    chosen : (BLOCK,) int64
        Overwritten.
    fill, margins, indices, conditions, lines
        Pieces. Without ``indices`` the margins leave the Jacobians, too, and conditions are taken
        of all points; without ``conditions`` it is ``indices`` that writes them.
    """
    bins = histogram.shape[2]
    axes = lower.shape[1]
    # At known places, so that the compiler sees that nothing overlaps.
    pose = scratch[scratch.shape[0] - axes :]
    margin = scratch[MARGIN]
    lci = scratch[LCI]
    weight = scratch[WEIGHT]
    # Indices are not negative: in that order lie their bits too, whose extremes vectors can take.
    bits = lci.view(np.int64)
    for design in range(constants.shape[0]):
        k = constants[design]
        for replicate in range(start.shape[0]):
            hits = 0
            reachable = 0.0
            within = 0.0
            total = 0.0
            smallest = INFINITE
            largest = -1
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
                if lines:
                    lines(scratch, count, lower[design], width[design], k)
                margins(scratch, count, k)
                if not indices:
                    conditions(scratch, count)
                kept = 0
                if lines:
                    for i in range(count):
                        chosen[kept] = i
                        if margin[i] >= 0.0 and weight[i] > 0.0:
                            kept += 1
                else:
                    for i in range(count):
                        chosen[kept] = i
                        if margin[i] >= 0.0:
                            kept += 1
                if kept == 0:
                    for i in range(count):
                        if margin[i] > best:
                            best = margin[i]
                    continue
                # Gathered by place: a move of each row at each point would not be vectorised.
                if lines:
                    gather(weight, chosen, kept, margin)
                if indices:
                    for d in range(axes):
                        gather(pose[d], chosen, kept, margin)
                    indices(scratch, kept, k)
                    if conditions:
                        conditions(scratch, kept)
                else:
                    gather(lci, chosen, kept, margin)
                if lines:
                    within += sum_of(weight, kept)
                else:
                    within += kept
                for i in range(kept):
                    largest = max(largest, bits[i])
                if min_lci > 0.0:
                    above = 0
                    for i in range(kept):
                        lci[above] = lci[i]
                        if lines:
                            weight[above] = weight[i]
                        if lci[i] >= min_lci:
                            above += 1
                    kept = above
                hits += kept
                for i in range(kept):
                    smallest = min(smallest, bits[i])
                if lines:
                    reachable += sum_of(weight, kept)
                    for i in range(kept):
                        margin[i] = weight[i] * lci[i]
                    total += sum_of(margin, kept)
                    for e in range(edges.shape[0]):
                        counts[e] += weight_above(lci, weight, edges[e], kept)
                    if bins > 0:
                        for i in range(kept):
                            chosen[i] = bin_of(bits[i])
                        for i in range(kept):
                            tally[chosen[i]] += weight[i]
                    continue
                reachable += kept
                total += sum_of(lci, kept)
                for e in range(edges.shape[0]):
                    edge = edges[e]
                    above = 0
                    for i in range(kept):
                        above += 1 if lci[i] >= edge else 0
                    counts[e] += above
                if bins > 0:
                    for i in range(kept):
                        chosen[i] = bin_of(bits[i])
                    for i in range(kept):
                        tally[chosen[i]] += 1
            row = statistics[design, replicate]
            row[REACHABLE] = reachable
            row[SUM_LCI] = total
            bits[0] = smallest
            bits[1] = largest
            row[MIN_LCI] = lci[0]
            row[MAX_LCI] = lci[1] if largest >= 0 else -np.inf
            row[BEST_MARGIN] = best
            row[WITHIN] = within
            row[HITS] = hits


def take(poses, first, count, pose):
    """Copy poses into a block."""
    for d in range(poses.shape[0]):
        for i in range(count):
            pose[d, i] = poses[d, first + i]


def field(poses, constants, margin, lci, scratch, margins, indices, conditions):
    """Evaluate given poses: ``poses`` (d, N), results ``margin`` (N,) and ``lci`` (N,).

    The index is evaluated outside the limits too, where it continues the inside (0 out of reach).
    """
    pose = scratch[scratch.shape[0] - poses.shape[0] :]
    found = scratch[MARGIN]
    index = scratch[LCI]
    for first in range(0, poses.shape[1], BLOCK):
        count = min(BLOCK, poses.shape[1] - first)
        take(poses, first, count, pose)
        margins(scratch, count, constants)
        for i in range(count):
            margin[first + i] = found[i]
        # Every index is wanted: with margins of 0 none is left in doubt.
        for i in range(count):
            found[i] = 0.0
        if indices:
            indices(scratch, count, constants)
        if conditions:
            conditions(scratch, count)
        for i in range(count):
            lci[first + i] = index[i]


def locate(poses, constants, tool, margin, places, scratch, placed):
    """Evaluate margins and places of given poses (d, N): ``margin`` (N,) and ``places`` (3, N).

    ``tool`` is the point of the platform that is told, in its frame.
    """
    pose = scratch[scratch.shape[0] - poses.shape[0] :]
    slack = scratch[MARGIN]
    work = scratch[WORK:]
    t1 = tool[0]
    t2 = tool[1]
    t3 = tool[2]
    for first in range(0, poses.shape[1], BLOCK):
        count = min(BLOCK, poses.shape[1] - first)
        take(poses, first, count, pose)
        placed(scratch, count, constants)
        for i in range(count):
            margin[first + i] = slack[i]
        for k in range(3):
            for i in range(count):
                places[k, first + i] = work[k, i] + (
                    work[3 + 3 * k, i] * t1 + work[4 + 3 * k, i] * t2 + work[5 + 3 * k, i] * t3
                )


def points(kind, step, start, high, low, cells, first, last, lower, width, poses, scratch, fill):
    """Write the points ``first .. last - 1`` of the first replicate into ``poses`` (d, N)."""
    pose = scratch[scratch.shape[0] - poses.shape[0] :]
    for block in range(first, last, BLOCK):
        count = min(BLOCK, last - block)
        fill(kind, step, start[0], high[0], low[0], cells, block, count, lower, width, pose)
        for d in range(poses.shape[0]):
            for i in range(count):
                poses[d, block - first + i] = pose[d, i]


def outline(
    kind, step, start, high, low, cells, first, last, constants, lower, width,
    axis_u, axis_v, edge, size, lowest, highest, scratch, rows, chosen, ends,
    fill, margins, skeletons,
):  # fmt: skip
    """Keep the ends of segments of reachable poses that bound their shadow on a plane.

    Of the points of the first replicate. In each of B equal strips along u the two points with the
    least and the greatest v are kept, and of all the two with the least and the greatest u (in the
    last row). The first and the last strip take what lies beyond them.

    Parameters
    ----------
    axis_u, axis_v : int
        Coordinates of the base frame that span the plane.
    edge, size : float
        Where the strips begin and how wide each is.
    lowest, highest : (B + 1, 2) float64
        The points (u, v) kept; unused ones hold infinities, as they are given.
    rows, ends : int
        The rows of a block, behind which skeletons are written, and how many ends segments have.
    """
    pose = scratch[rows - lower.shape[0] : rows]
    margin = scratch[MARGIN]
    work = scratch[rows:]
    strips = lowest.shape[0] - 1
    for block in range(first, last, BLOCK):
        count = min(BLOCK, last - block)
        fill(kind, step, start[0], high[0], low[0], cells, block, count, lower, width, pose)
        margins(scratch, count, constants)
        kept = 0
        for i in range(count):
            chosen[kept] = i
            if margin[i] >= 0.0:
                kept += 1
        for d in range(lower.shape[0]):
            gather(pose[d], chosen, kept, margin)
        skeletons(scratch, kept, constants)
        for i in range(kept):
            for e in range(ends):
                u = work[PLACE + 3 * e + axis_u, i]
                v = work[PLACE + 3 * e + axis_v, i]
                strip = int(min(max((u - edge) / size, 0.0), strips - 1.0))
                if v < lowest[strip, 1]:
                    lowest[strip, 0] = u
                    lowest[strip, 1] = v
                if v > highest[strip, 1]:
                    highest[strip, 0] = u
                    highest[strip, 1] = v
                if u < lowest[strips, 0]:
                    lowest[strips, 0] = u
                    lowest[strips, 1] = v
                if u > highest[strips, 0]:
                    highest[strips, 0] = u
                    highest[strips, 1] = v
