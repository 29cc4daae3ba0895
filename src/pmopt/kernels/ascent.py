"""Steps of a search for a pose with a given position and a slack of at least 0.

:func:`advance` allocates nothing and never raises. Newton's method leads to the fibre of the poses
that have the position; along it the slack, the least of many, is raised. Its slopes at the last
poses of a search give planes, and a step leads to where the least of them is largest, within a
distance that is trusted (Kelley 1960).
"""

from __future__ import annotations

import math

#: Directions along a fibre that a step moves in, and planes that are kept.
MOST_FREE = 2
PLANES = 5
#: Shift of a coordinate for differences, in units of the poses, as steps are.
DIFFERENCE = 1e-6
#: Misses, in units of the positions: none, little, and what tells that a fibre bends.
CLOSE = 1e-6
NEAR = 1e-2
BENT = 3e-3
#: Steps along a fibre that are none, that a search begins with, and the longest of all.
LEAST_STEP = 1e-4
FIRST_STEP = 0.25
LONGEST = 0.5
#: The share of the lack of slack that a step at its longest must promise to make up for.
HALF = 0.5
#: Of the height that the planes promise above 0, the share that is stepped for.
AIM = 0.3
#: Of the rise that is aimed at, the share that may be lost.
POOR = 0.75
#: Rows of the state of searches.
STEP, MISSED, PART, FROM, AIMED = range(5)
STATE = 5
#: Steps before a search is given up.
HOPE_TURNS = 5
#: What a search is at.
GOES_ON, REACHED, ENDED = 0, 1, 2


def least_plane(planes, count, s0, s1):  # type: ignore[no-untyped-def]
    """Return the height of the lowest plane at a place; rows: height at 0 and two slopes."""
    low = planes[0, 0] + planes[0, 1] * s0 + planes[0, 2] * s1
    for p in range(1, count):
        height = planes[p, 0] + planes[p, 1] * s0 + planes[p, 2] * s1
        low = height if height < low else low
    return low


def offer(planes, count, step, s0, s1, best):  # type: ignore[no-untyped-def]
    """Return the better of a place, moved into |s| <= step, and the best so far."""
    s0 = -step if s0 < -step else (step if s0 > step else s0)
    s1 = -step if s1 < -step else (step if s1 > step else s1)
    low = least_plane(planes, count, s0, s1)
    return (s0, s1, low) if low > best[2] else best  # a NaN is not larger


def highest(planes, count, free, step):  # type: ignore[no-untyped-def]
    """Return where in |s| <= step the least of planes is largest, and its height there."""
    best = (0.0, 0.0, least_plane(planes, count, 0.0, 0.0))
    other = step if free > 1 else 0.0
    for i in range(4 if free > 1 else 2):
        best = offer(planes, count, step, step * (1 - 2 * (i % 2)), other * (1 - i // 2 * 2), best)
    for a in range(count):
        for b in range(a + 1, count):
            gap = planes[b, 0] - planes[a, 0]
            tilt0 = planes[a, 1] - planes[b, 1]
            tilt1 = planes[a, 2] - planes[b, 2]
            if free == 1:
                best = offer(planes, count, step, gap / tilt0, 0.0, best)
                continue
            for i in range(2):
                end = step * (1 - 2 * i)
                best = offer(planes, count, step, end, (gap - tilt0 * end) / tilt1, best)
                best = offer(planes, count, step, (gap - tilt1 * end) / tilt0, end, best)
            for c in range(b + 1, count):
                gap2 = planes[c, 0] - planes[a, 0]
                tilt2 = planes[a, 1] - planes[c, 1]
                tilt3 = planes[a, 2] - planes[c, 2]
                unit = 1.0 / (tilt0 * tilt3 - tilt1 * tilt2)
                best = offer(
                    planes, count, step,
                    (gap * tilt3 - gap2 * tilt1) * unit, (tilt0 * gap2 - tilt2 * gap) * unit, best,
                )  # fmt: skip
    return best


def newton(places, goal, axes, j, i, vectors):  # type: ignore[no-untyped-def]
    """Write orthonormal rows that span those of the position's Jacobian, and the root's step.

    Rows 0 .. 2 of ``vectors``, and row 3: the shortest step that makes up for the miss.
    """
    for k in range(3):
        rest = goal[k, i] - places[k, 0, j]
        for d in range(axes):
            vectors[k, d] = (places[k, 1 + d, j] - places[k, 0, j]) / DIFFERENCE
        for m in range(k):
            share = 0.0
            for d in range(axes):
                share += vectors[k, d] * vectors[m, d]
                rest -= vectors[k, d] * vectors[3, d] if m == 0 else 0.0  # made up for before
            for d in range(axes):
                vectors[k, d] -= share * vectors[m, d]
        length = 0.0
        for d in range(axes):
            length += vectors[k, d] * vectors[k, d]
        # A position that does not change in some direction leads nowhere far.
        unit = 1.0 / max(math.sqrt(length), 1e-9)
        for d in range(axes):
            vectors[k, d] *= unit
            vectors[3, d] = (0.0 if k == 0 else vectors[3, d]) + rest * unit * vectors[k, d]


def across(axes, free, vectors):  # type: ignore[no-untyped-def]
    """Write orthonormal vectors across rows 0 .. 2 into the rows from 4 on."""
    have = 3
    for f in range(free):
        first = 0
        longest = -1.0
        for d in range(axes):
            left = 1.0
            for m in range(have):
                row = m if m < 3 else m + 1
                left -= vectors[row, d] * vectors[row, d]
            if left > longest:
                longest = left
                first = d
        for d in range(axes):
            vectors[4 + f, d] = 1.0 if d == first else 0.0
        for m in range(have):
            row = m if m < 3 else m + 1
            share = 0.0
            for d in range(axes):
                share += vectors[4 + f, d] * vectors[row, d]
            for d in range(axes):
                vectors[4 + f, d] -= share * vectors[row, d]
        length = 0.0
        for d in range(axes):
            length += vectors[4 + f, d] * vectors[4 + f, d]
        unit = 1.0 / max(math.sqrt(length), 1e-300)
        for d in range(axes):
            vectors[4 + f, d] *= unit
        have += 1


def raise_slack(  # type: ignore[no-untyped-def]
    turn, axes, free, miss, here, i, state, poses, heights, slopes, vectors, planes
):
    """Add the step along the fibre to row 3 of ``vectors``; return whether there is no way."""
    count = turn + 1 if turn + 1 < PLANES else PLANES
    across(axes, free, vectors)
    for p in range(count):
        value = heights[p, i]
        for d in range(axes):
            value += slopes[p, d, i] * (poses[d, i] + vectors[3, d])
        planes[p, 0] = value
        for f in range(MOST_FREE):
            value = 0.0
            if f < free:
                for d in range(axes):
                    value += slopes[p, d, i] * vectors[4 + f, d]
            planes[p, 1 + f] = value
    # Where the fibre bends, or planes are not above the slack, steps are to be short.
    bound = state[AIMED, i] - POOR * (state[AIMED, i] - state[FROM, i])
    if turn > 0 and (miss > BENT or here < bound):
        state[STEP, i] *= 0.5
    s0, s1, top = highest(planes, count, free, state[STEP, i])
    value = least_plane(planes, count, 0.0, 0.0)
    # Where the planes would not raise half of what is missing in the longest step, there is no way.
    promise = value + (top - value) * FIRST_STEP / state[STEP, i]
    hopeless = miss <= NEAR and turn >= HOPE_TURNS and promise < HALF * min(value, 0.0)
    still = miss <= CLOSE and top < 0.0 and max(abs(s0), abs(s1)) < LEAST_STEP
    # No further along the fibre than is needed: its bends would lead off it.
    share = 1.0
    if value >= 0.0:
        share = 0.0
    elif top > 0.0:
        share = min((AIM * top - value) / (top - value), 1.0)
    s0 *= share
    s1 *= share
    state[FROM, i] = value
    state[AIMED, i] = least_plane(planes, count, s0, s1)
    for d in range(axes):
        vectors[3, d] += s0 * vectors[4, d]
        if free > 1:
            vectors[3, d] += s1 * vectors[5, d]
    return hopeless or still


def add_plane(  # type: ignore[no-untyped-def]
    slot, axes, i, j, here, slack, lower, upper, poses, heights, slopes
):
    """Keep the plane of a pose: its slopes and its height at the origin."""
    height = here
    for d in range(axes):
        moved = slack[1 + d, j]
        for e in range(axes):
            p = poses[e, i] + (DIFFERENCE if e == d else 0.0)
            moved = min(moved, p - lower[e], upper[e] - p)
        slope = (moved - here) / DIFFERENCE
        slopes[slot, d, i] = slope
        height -= slope * poses[d, i]
    heights[slot, i] = height


def advance(  # type: ignore[no-untyped-def]
    turn, at, slack, places, goal, lower, upper, poses, state, heights, slopes, before, status,
    vectors, planes,
):  # fmt: skip
    """Take the next step of some searches.

    Parameters
    ----------
    turn : int
        Steps taken before.
    at : (n,) int64
        Numbers of these searches among all N.
    slack, places : (1 + d, n), (3, 1 + d, n) float64
        At each one's pose and at that pose moved by DIFFERENCE along each coordinate.
    goal : (3, N) float64
        The positions asked for.
    lower, upper : (d,) float64
        Bounds of the poses, that lower the slack.
    poses : (d, N) float64
        Moved, but for a search that has ended.
    state : (STATE, N) float64
        Of each search: the trusted distance along the fibre, FIRST_STEP at first; the last miss;
        which part of a step is left; the slack expected before and after the last step.
    heights, slopes : (PLANES, N), (PLANES, d, N) float64
        Planes of the last poses.
    before : (d, N) float64
        Poses before the last steps.
    status : (N,) int64
        Written.
    vectors, planes : (4 + MOST_FREE, d), (PLANES, 1 + MOST_FREE) float64
        Overwritten.
    """
    axes = poses.shape[0]
    free = axes - 3 if axes - 3 < MOST_FREE else MOST_FREE
    slot = turn % PLANES
    for j in range(at.shape[0]):
        i = at[j]
        inside = math.inf
        for d in range(axes):
            inside = min(inside, poses[d, i] - lower[d], upper[d] - poses[d, i])
        here = min(slack[0, j], inside)
        miss = 0.0
        for k in range(3):
            miss = max(miss, abs(goal[k, i] - places[k, 0, j]))
        # A step that has led away, or not as near as it ought to, is halved. One along a fibre may
        # lead off it a little.
        least = state[MISSED, i]
        least = least if free > 0 else least * (1.0 - 0.5 * state[PART, i])
        found = GOES_ON
        if not (miss < math.inf and here > -math.inf):
            found = ENDED
        elif miss <= CLOSE and here >= 0.0:
            found = REACHED
        elif miss <= CLOSE and free <= 0:
            found = ENDED
        elif turn > 0 and miss > least and (free <= 0 or miss > NEAR):
            state[PART, i] *= 0.5
            for d in range(axes):
                poses[d, i] = 0.5 * (poses[d, i] + before[d, i])
            # The plane before stands in for this one.
            heights[slot, i] = heights[(turn - 1) % PLANES, i]
            for d in range(axes):
                slopes[slot, d, i] = slopes[(turn - 1) % PLANES, d, i]
        else:
            state[MISSED, i] = miss
            state[PART, i] = 1.0
            newton(places, goal, axes, j, i, vectors)
            over = False
            if free > 0:
                add_plane(slot, axes, i, j, here, slack, lower, upper, poses, heights, slopes)
                over = raise_slack(
                    turn, axes, free, miss, here, i, state, poses, heights, slopes, vectors, planes
                )
            length = 0.0
            for d in range(axes):
                length += vectors[3, d] * vectors[3, d]
            length = math.sqrt(length)
            if over or not length < math.inf:
                found = ENDED
            else:
                scale = 1.0 if length <= LONGEST else LONGEST / length
                for d in range(axes):
                    before[d, i] = poses[d, i]
                    poses[d, i] += scale * vectors[3, d]
        status[i] = found
