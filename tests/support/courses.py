"""Smooth motions about home, of any mechanism that can move."""

import numpy as np

from pmopt.mechanisms import find, names

MOVED = [name for name in names() if find(name).posture is not None]
#: Around home, in lengths of the characteristic length and rad.
SWING = 0.12


def course(name, t, seed=0, swing=SWING):
    """Return a smooth motion about home: poses, rates and accelerations at the times."""
    mechanism = find(name)
    parameters = mechanism.resolve({})
    home = np.array(list(mechanism.home(parameters).values()))
    size = mechanism.characteristic_length(parameters)
    rng = np.random.default_rng([seed, len(name)])
    n = len(home)
    scale = np.array([size if c.kind == "length" else 1.0 for c in mechanism.pose])
    swing = swing * scale * rng.uniform(0.3, 1.0, n)
    speed, phase = rng.uniform(1.0, 3.0, n), rng.uniform(-3.0, 3.0, n)
    angle = np.multiply.outer(t, speed) + phase
    return (
        home + swing * np.sin(angle),
        swing * speed * np.cos(angle),
        -swing * speed**2 * np.sin(angle),
    )
