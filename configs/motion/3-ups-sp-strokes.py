"""Makes 3-ups-sp-strokes.csv: poses at which a nozzle writes PM on a curved surface.

The nozzle stands NOZZLE above the platform's centre, along its normal. Its tip lies at
A4 + R (-b4 + (0, 0, l4 + NOZZLE)): the tip's distance from A4 tells l4, its direction two of the
three rotations; the third, phi, is held. Every stroke starts and ends at rest, lifted in between.

Run it with: python configs/motion/3-ups-sp-strokes.py
"""

import csv
import math
from pathlib import Path

NOZZLE = 20.0  # mm
PHI = 0.0  # rad
A, a, TWIST = 35.0, 20.0, 0.6  # sides in mm and rad, as in 3-ups-sp-strokes.toml
CENTRE, TOP, RADIUS = (-7.5, -7.5), 86.0, 90.0  # of the sphere's cap that is written on, mm
LIFT, RATE, STEP = 3.0, 20.0, 0.02  # mm off the surface between strokes, mean mm/s, s

# Strokes as polylines in mm about the centre, x to the right.
ROUND = [
    (-9 + 4 * math.sin(turn), 2.5 + 3.5 * math.cos(turn))
    for turn in [math.pi * k / 256 for k in range(257)]
]
STROKES = [
    [(-9.0, -6.0), (-9.0, 6.0)],
    ROUND,
    [(2.0, -6.0), (2.0, 6.0)],
    [(2.0, 6.0), (6.0, -1.0)],
    [(6.0, -1.0), (10.0, 6.0)],
    [(10.0, 6.0), (10.0, -6.0)],
]


def surface(x, y, lift):
    """Return the tip's position above a point of the surface."""
    return CENTRE[0] + x, CENTRE[1] + y, TOP - RADIUS + math.sqrt(RADIUS**2 - x * x - y * y) - lift


def along(points, share):
    """Return the point at a share of a polyline's length."""
    sizes = [math.dist(p, q) for p, q in zip(points, points[1:], strict=False)]
    left = share * sum(sizes)
    number = 0
    while left > sizes[number] and number < len(sizes) - 1:
        left -= sizes[number]
        number += 1
    part = min(left / sizes[number], 1.0)
    return tuple(u + part * (v - u) for u, v in zip(*points[number : number + 2], strict=True))


def smooth(u):
    """Return the share of a stretch after a share of its time, from rest to rest."""
    return u**3 * (10 - 15 * u + 6 * u * u)


def tips():
    """Yield the tip's positions, a step apart in time."""
    here, lifted = STROKES[0][0], True
    yield surface(*here, LIFT)
    for stroke in STROKES:
        moves = []
        if stroke[0] != here:
            moves += [] if lifted else [([here, here], 0.0, LIFT)]
            moves += [([here, stroke[0]], LIFT, LIFT)]
            lifted = True
        if lifted:
            moves.append(([stroke[0]] * 2, LIFT, 0.0))
        moves.append((stroke, 0.0, 0.0))
        for points, low, high in moves:
            size = sum(math.dist(p, q) for p, q in zip(points, points[1:], strict=False))
            count = math.ceil(max(size, abs(high - low)) / RATE / STEP) + 10
            for k in range(1, count + 1):
                s = smooth(k / count)
                place = along(points, s) if size else points[0]
                yield surface(*place, low + s * (high - low))
        here, lifted = stroke[-1], False


def pose(tip):
    """Return phi, theta, psi and l4 that bring the nozzle's tip to a place."""
    corner = (
        -a / 2 * (math.cos(TWIST) - math.sin(TWIST)),
        -a / 2 * (math.cos(TWIST) + math.sin(TWIST)),
    )
    x, y, z = (p - q for p, q in zip(tip, (-A / 2, -A / 2, 0.0), strict=True))
    x, y = math.cos(PHI) * x + math.sin(PHI) * y, math.cos(PHI) * y - math.sin(PHI) * x
    height = math.sqrt(x * x + y * y + z * z - corner[0] ** 2 - corner[1] ** 2)
    # cos theta x - sin theta z = -b4x, then psi turns (-b4y, height) into what is left.
    size = math.hypot(x, z)
    theta = math.acos(-corner[0] / size) - math.atan2(z, x)
    up = math.sin(theta) * x + math.cos(theta) * z
    psi = math.atan2(up, y) - math.atan2(height, -corner[1])
    return PHI, theta, psi, height - NOZZLE


def main():
    """Write the poses beside this file."""
    with Path(__file__).with_suffix(".csv").open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("t", "phi", "theta", "psi", "l4"))
        for number, tip in enumerate(tips()):
            writer.writerow((round(number * STEP, 6), *(round(v, 9) for v in pose(tip))))


if __name__ == "__main__":
    main()
