"""Distance between links as branch-free scalar code; kernel functions, see sweep."""

TINY = 1e-300


def unit_interval(value):
    """Return the value clamped to [0, 1]."""
    value = value if value > 0.0 else 0.0
    return value if value < 1.0 else 1.0


def segment_distance2(a, b, c, d):
    """Return the squared distance between the segments from a to b and from c to d.

    C. Ericson, "Real-Time Collision Detection", section 5.1.9. Parallel segments start from a.
    """
    ux, uy, uz = b.x - a.x, b.y - a.y, b.z - a.z
    vx, vy, vz = d.x - c.x, d.y - c.y, d.z - c.z
    rx, ry, rz = a.x - c.x, a.y - c.y, a.z - c.z
    uu = ux * ux + uy * uy + uz * uz
    vv = vx * vx + vy * vy + vz * vz
    uv = ux * vx + uy * vy + uz * vz
    ur = ux * rx + uy * ry + uz * rz
    vr = vx * rx + vy * ry + vz * rz
    across = uu * vv - uv * uv
    s = (uv * vr - ur * vv) / (across + TINY)
    s = unit_interval(s) if across > 1e-12 * uu * vv else 0.0
    t = unit_interval((uv * s + vr) / (vv + TINY))
    s = unit_interval((uv * t - ur) / (uu + TINY))
    x = rx + s * ux - t * vx
    y = ry + s * uy - t * vy
    z = rz + s * uz - t * vz
    return x * x + y * y + z * z
