"""What a limb's stroke leaves of a line along a translation; kernel functions, see sweep."""

import math


def part_within_stroke(start, end, centre, across2, low, high):
    """Cut a part of a line to where a limb's length^2 = (t - centre)^2 + across2 is in its limits.

    Of the two parts that the lower limit leaves one is dropped where the line does not reach it;
    where it reaches both, the gap between them is left to the margin.
    """
    outer = high * high - across2
    inner = low * low - across2
    far = math.sqrt(outer if outer > 0.0 else 0.0)
    near = math.sqrt(inner if inner > 0.0 else 0.0)
    start = centre - far if centre - far > start else start
    end = centre + far if centre + far < end else end
    start = centre + near if centre - near <= start < centre + near else start
    end = centre - near if centre - near < end <= centre + near else end
    return start, (end if outer > 0.0 else start)
