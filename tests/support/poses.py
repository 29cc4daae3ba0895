"""Poses of any mechanism, and what its kernel needs at them."""

import numpy as np

from pmopt.compiler.records import named


def box(mechanism, params):
    """Return the reach box under the default limits."""
    return mechanism.reach_box(params, mechanism.default_limits(params))


def random_poses(mechanism, params, count, seed=1, margin=0.0):
    """Return poses in the reach box, widened by a share of its width on every side."""
    lower, upper = box(mechanism, params)
    width = upper - lower
    unit = np.random.default_rng(seed).uniform(-margin, 1 + margin, (count, len(lower)))
    return [
        {c.name: float(v) for c, v in zip(mechanism.pose, row, strict=True)}
        for row in lower + unit * width
    ]


def ready(mechanism, params, mode, length=1.0, limits=None):
    """Return the kernel's constants under the default limits, some of them replaced."""
    merged = {**mechanism.default_limits(params), **(limits or {})}
    return mechanism.kernel_constants(params, mode, length, merged)


def constants_of(mechanism, design):
    """Return the kernel's constants of a design, without those of checks."""
    return named(mechanism.constants, design.constants)


def _candidates(mechanism, params, count, seed):
    """Yield random poses of the box; of six coordinates, where few are reachable, nearer home."""
    poses = random_poses(mechanism, params, 400 * count, seed)
    if len(mechanism.pose) < 6:
        yield from poses
        return
    home = mechanism.home(params)
    for pose in poses:
        yield {name: at + 0.1 * (pose[name] - at) for name, at in home.items()}


#: Pairs that :func:`reachable` has found, with the mechanism, whose identity the key has.
_FOUND = {}


def reachable(mechanism, params, count, mode=None, seed=1):
    """Return ``count`` random (pose, solution) pairs of a working mode, by default the first."""
    mode = mode or mechanism.working_modes[0]
    key = id(mechanism), tuple(params.items()), count, mode, seed
    if key not in _FOUND:
        _FOUND[key] = mechanism, _search(mechanism, params, count, mode, seed)
    return [(dict(pose), solution) for pose, solution in _FOUND[key][1]]


def _search(mechanism, params, count, mode, seed):
    constants = ready(mechanism, params, mode)
    pairs = []
    for pose in _candidates(mechanism, params, count, seed):
        if mechanism.kernel(*pose.values(), constants)[0] < 0:
            continue
        pairs += [(pose, s) for s in mechanism.inverse(params, pose) if s.working_mode == mode]
        if len(pairs) == count:
            return pairs
    raise AssertionError("hardly a pose of the box is reachable")
