"""Sets of cells and outlines of points: the counting behind shapes.

Called by :mod:`pmopt.analysis.sampling.cells`, which prepares the arrays. Nothing is allocated
here, and nothing raises.
"""

from __future__ import annotations


def lattice(axes, count, points):  # type: ignore[no-untyped-def]
    """Write the points of :func:`lattice_points`."""
    dimension = axes.shape[0]
    total = points.shape[1]
    repeat = total
    for d in range(dimension):
        repeat //= count
        row = points[d]
        i = 0
        while i < total:
            for k in range(count):
                value = axes[d, k]
                for j in range(i, i + repeat):
                    row[j] = value
                i += repeat


def label_runs(rows, back, reach, labels, runs, begins, count):  # type: ignore[no-untyped-def]
    """Number the pieces of a set with a border of cells that do not belong to it.

    Runs of a row (first cell, one past the last, a run of the same piece) are joined with those of
    the rows before it that they touch; the earliest run stands for its piece.
    """
    found = 0
    for row in range(rows.shape[0]):
        begins[row] = found
        inside = False
        for i in range(rows.shape[1]):
            if (rows[row, i] != 0) != inside:
                inside = not inside
                if inside:
                    runs[found, 0] = i
                    runs[found, 2] = found
                else:
                    runs[found, 1] = i
                    found += 1
        begins[row + 1] = found
        if begins[row] == found:
            continue
        for k in range(back.shape[0]):
            other = row + back[k]
            here = begins[row]
            there = begins[other]
            while here < found and there < begins[other + 1]:
                if (
                    runs[here, 0] < runs[there, 1] + reach
                    and runs[there, 0] < runs[here, 1] + reach
                ):
                    a = here
                    while runs[a, 2] != a:
                        runs[a, 2] = runs[runs[a, 2], 2]
                        a = runs[a, 2]
                    b = there
                    while runs[b, 2] != b:
                        runs[b, 2] = runs[runs[b, 2], 2]
                        b = runs[b, 2]
                    runs[max(a, b), 2] = min(a, b)
                if runs[here, 1] < runs[there, 1]:
                    here += 1
                else:
                    there += 1
    pieces = 0
    for run in range(found):
        first = runs[run, 2]
        if first == run:
            pieces += 1
            runs[run, 2] = pieces
        else:  # an earlier run, which has its number
            runs[run, 2] = runs[first, 2]
    for row in range(rows.shape[0]):
        for run in range(begins[row], begins[row + 1]):
            for i in range(runs[run, 0], runs[run, 1]):
                labels[row, i] = runs[run, 2]
    count[0] = pieces


def chain(points, corners, count):  # type: ignore[no-untyped-def]
    """Write the places of a hull's corners among points in ascending order (Andrew 1979)."""
    size = points.shape[0]
    height = 0
    for turn in range(2):
        start = height
        for k in range(size):
            i = k if turn == 0 else size - 1 - k
            while height - start >= 2:
                a = corners[height - 2]
                b = corners[height - 1]
                across = (points[b, 0] - points[a, 0]) * (points[i, 1] - points[a, 1]) - (
                    points[b, 1] - points[a, 1]
                ) * (points[i, 0] - points[a, 0])
                if across > 0.0:
                    break
                height -= 1
            corners[height] = i
            height += 1
        height -= 1  # the last corner of a chain is the first one of the other
    count[0] = height
