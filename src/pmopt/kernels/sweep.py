"""The compiled sweep over sample points: the text that is specialised to a mechanism.

The functions below are plain Python. :mod:`pmopt.compiler.program_text` copies their source,
with a mechanism's kernel and a conditioning function in place of the stubs, into one
self-contained module that is compiled. They hold no lock, allocate nothing (block buffers are
arguments) and never raise: the caller checks its arguments.

Reductions: points are taken in blocks of fixed length in order of their index, so that the sums
of a call depend on its arguments alone. Sums of several calls are added by the caller in order.
"""

import numpy as np

BLOCK = 512
#: Distance of the rows of a block: rows 4096 bytes apart would share their places in the cache.
PITCH = BLOCK + 72

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


def margin_of(pose, i, constants):
    """Stub: the margin of pose ``i`` of a block, from the mechanism's kernel."""
    raise NotImplementedError


def index_block(pose, count, constants, work, lci):
    """Stub: write the local conditioning indices of ``count`` poses of a block.

    Poses and indices are rows of PITCH: up to a whole vector more of each is written.
    ``work`` is scratch space, a row for each entry of the Jacobian.
    """
    raise NotImplementedError


def evaluate_block(pose, count, constants, work, margins):
    """Stub, for heavy kernels: write margins and, into ``work``, entries of a block's poses."""
    raise NotImplementedError


def index_all(count, work, margins, lci):
    """Stub: write the indices of entries in ``work``; doubtful ones, < 0, only out of reach."""
    raise NotImplementedError


def place_on_line(pose, i, low, width, constants):
    """Stub: move pose ``i`` into the reachable part of its line, from the mechanism's ``line``.

    Returns the coordinate and the part's share of the line, 0 where nothing of it is reachable.
    """
    raise NotImplementedError


def facts_of(pose, i, constants):
    """Stub: what ``probe`` writes of pose ``i`` of a block, as a tuple."""
    raise NotImplementedError


#: Stub: coordinates of a pose.
AXES = 0
#: Stub: whether points are placed on the reachable parts of lines, and along which coordinate.
LINES = 0
LINE_AXIS = 0
#: Stub: whether the kernel costs so much that it is evaluated once for margin and entries.
HEAVY = 0
#: Stub: length of the tuple of ``facts_of``.
FACTS = 0


def skeleton_of(pose, i, constants):
    """Stub: the skeleton of pose ``i`` of a block, as a tuple."""
    raise NotImplementedError


def placed_of(pose, i, constants):
    """Stub: margin, position and rotation of the platform at pose ``i`` of a block, as a tuple."""
    raise NotImplementedError


#: Stub: where the ends of segments begin in it, and how many there are.
PLACE = 0
ENDS = 0


def unpack(constants):
    """Stub: a row of constants as a tuple, so that the compiler keeps them in registers."""
    raise NotImplementedError


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
    statistics, region_counts, histogram, scratch, chosen,
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
    """
    bins = histogram.shape[2]
    # At known places, so that the compiler sees that nothing overlaps.
    pose = scratch[:AXES]
    margin = scratch[AXES]
    lci = scratch[AXES + 1]
    weight = scratch[AXES + 2]
    work = scratch[AXES + 3 :]
    # Indices are not negative: in that order lie their bits too, whose extremes vectors can take.
    bits = lci.view(np.int64)
    for design in range(constants.shape[0]):
        k = unpack(constants[design])
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
                if LINES:
                    for i in range(count):
                        place, share = place_on_line(
                            pose, i, lower[design, LINE_AXIS], width[design, LINE_AXIS], k
                        )
                        pose[LINE_AXIS, i] = place
                        weight[i] = share
                if HEAVY:
                    evaluate_block(pose, count, k, work, margin)
                    index_all(count, work, margin, lci)
                else:
                    for i in range(count):
                        margin[i] = margin_of(pose, i, k)
                kept = 0
                for i in range(count):
                    chosen[kept] = i
                    if LINES:
                        if margin[i] >= 0.0 and weight[i] > 0.0:
                            kept += 1
                    elif margin[i] >= 0.0:
                        kept += 1
                if kept == 0:
                    for i in range(count):
                        if margin[i] > best:
                            best = margin[i]
                    continue
                # Gathered by place: a move of each row at each point would not be vectorised.
                if LINES:
                    gather(weight, chosen, kept, margin)
                if HEAVY:
                    gather(lci, chosen, kept, margin)
                else:
                    for d in range(AXES):
                        gather(pose[d], chosen, kept, margin)
                    index_block(pose, kept, k, work, lci)
                within += sum_of(weight, kept) if LINES else kept
                for i in range(kept):
                    largest = max(largest, bits[i])
                if min_lci > 0.0:
                    above = 0
                    for i in range(kept):
                        lci[above] = lci[i]
                        if LINES:
                            weight[above] = weight[i]
                        if lci[i] >= min_lci:
                            above += 1
                    kept = above
                hits += kept
                for i in range(kept):
                    smallest = min(smallest, bits[i])
                if LINES:
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


def field(poses, constants, margin, lci, scratch):
    """Evaluate given poses: ``poses`` (d, N), results ``margin`` (N,) and ``lci`` (N,).

    The index is evaluated outside the limits too, where it continues the inside (0 out of reach).
    """
    k = unpack(constants)
    pose = scratch[:AXES]
    margins = scratch[AXES]
    indices = scratch[AXES + 1]
    within = scratch[AXES + 2]
    work = scratch[AXES + 3 :]
    # Every index is wanted: with margins of 0 none is left in doubt.
    within[:] = 0.0
    for first in range(0, poses.shape[1], BLOCK):
        count = min(BLOCK, poses.shape[1] - first)
        for d in range(AXES):
            for i in range(count):
                pose[d, i] = poses[d, first + i]
        if HEAVY:
            evaluate_block(pose, count, k, work, margins)
            index_all(count, work, within, indices)
        else:
            for i in range(count):
                margins[i] = margin_of(pose, i, k)
            index_block(pose, count, k, work, indices)
        for i in range(count):
            margin[first + i] = margins[i]
            lci[first + i] = indices[i]


def locate(poses, constants, tool, margin, places, scratch):
    """Evaluate margins and places of given poses (d, N): ``margin`` (N,) and ``places`` (3, N).

    ``tool`` is the point of the platform that is told, in its frame.
    """
    k = unpack(constants)
    pose = scratch[:AXES]
    slack = scratch[AXES]
    x = scratch[AXES + 1]
    y = scratch[AXES + 2]
    z = scratch[AXES + 3]
    t1 = tool[0]
    t2 = tool[1]
    t3 = tool[2]
    for first in range(0, poses.shape[1], BLOCK):
        count = min(BLOCK, poses.shape[1] - first)
        for d in range(AXES):
            for i in range(count):
                pose[d, i] = poses[d, first + i]
        for i in range(count):
            found = placed_of(pose, i, k)
            slack[i] = found[0]
            x[i] = found[1] + (found[4] * t1 + found[5] * t2 + found[6] * t3)
            y[i] = found[2] + (found[7] * t1 + found[8] * t2 + found[9] * t3)
            z[i] = found[3] + (found[10] * t1 + found[11] * t2 + found[12] * t3)
        for i in range(count):
            margin[first + i] = slack[i]
            places[0, first + i] = x[i]
            places[1, first + i] = y[i]
            places[2, first + i] = z[i]


def points(kind, step, start, high, low, cells, first, last, lower, width, poses, scratch):
    """Write the points ``first .. last - 1`` of the first replicate into ``poses`` (d, N)."""
    pose = scratch[:AXES]
    for block in range(first, last, BLOCK):
        count = min(BLOCK, last - block)
        fill(kind, step, start[0], high[0], low[0], cells, block, count, lower, width, pose)
        for d in range(AXES):
            for i in range(count):
                poses[d, block - first + i] = pose[d, i]


def outline(
    kind, step, start, high, low, cells, first, last, constants, lower, width,
    axis_u, axis_v, edge, size, lowest, highest, scratch,
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
    """
    k = unpack(constants)
    pose = scratch[:AXES]
    margin = scratch[AXES]
    work = scratch[AXES + 3 :]
    strips = lowest.shape[0] - 1
    for block in range(first, last, BLOCK):
        count = min(BLOCK, last - block)
        fill(kind, step, start[0], high[0], low[0], cells, block, count, lower, width, pose)
        if HEAVY:
            evaluate_block(pose, count, k, work, margin)
        else:
            for i in range(count):
                margin[i] = margin_of(pose, i, k)
        for i in range(count):
            if margin[i] < 0.0:
                continue
            found = skeleton_of(pose, i, k)
            for e in range(ENDS):
                u = found[PLACE + 3 * e + axis_u]
                v = found[PLACE + 3 * e + axis_v]
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


def probe(poses, constants, facts):
    """Write what the kernel and the skeleton tell of given poses, ``facts`` (FACTS, N).

    Rows: margin, entries of the inverse Jacobian, skeleton.
    """
    k = unpack(constants)
    for i in range(poses.shape[1]):
        found = facts_of(poses, i, k)
        for f in range(FACTS):
            facts[f, i] = found[f]
