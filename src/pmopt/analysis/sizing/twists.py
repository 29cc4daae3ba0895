"""Sets of platform motions of given sizes, and the most that a joint is asked for over them.

At a pose the rates x of the pose's coordinates move the platform's centre with ``v = A x`` and turn
the platform with the angular velocity ``w = W x``, what is parasitic included. A task gives sizes:

- only of v: v is any vector of that size in the range of A, with the least |w| that goes with it
  (0 where the platform can translate without turning);
- only of w: w is any vector of that size in the range of W, with the least |v|;
- of both: every x with |A x| and |W x| within their sizes.

Each is the set of a mechanism's twists at the pose, whatever its coordinates are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.numerics.matrices import decomposed, eigen, product

Values = NDArray[np.float64]

#: Directions in which the platform moves less than this share of the fastest do not count.
_RANK = 1e-6
#: Steps that narrow the weight between two bounds, and weights tried where each takes long.
_STEPS, _WEIGHTS = 48, (0.3, 0.5, 0.7)
_GOLDEN = (5**0.5 - 1) / 2


@dataclass(frozen=True)
class Motions:
    """Motions of the platform at N poses with d coordinates.

    Attributes
    ----------
    point, turn : (N, 3, d) float64
        A and W, in m and rad.
    speed, turning : float
        Sizes of v (m/s, or m/s^2) and w (rad/s, rad/s^2); 0 where one is not given.
    length : float
        m, about the platform's size: what makes turning comparable with moving.
    """

    point: Values
    turn: Values
    speed: float
    turning: float
    length: float

    def most(self, rows: Values) -> Values:
        """Return the largest ``|r x|`` over the motions x of each of the rows (N, n, d)."""
        if not (self.speed and self.turning):
            spanned = self._spanned()
            if spanned is None:
                return np.zeros(rows.shape[:2])
            return np.asarray(np.linalg.norm(product(rows, spanned), axis=2))
        root, share = self._joined()
        squares = product(rows, root) ** 2
        share = share[:, None, :]

        def bound(weight: Values) -> Values:
            w = weight[:, :, None]
            with np.errstate(divide="ignore", invalid="ignore"):
                parts = squares / (w * share + (1 - w) * (1 - share))
            total: Values = np.where(squares == 0, 0.0, parts).sum(axis=2)
            return total

        # Every weight gives a bound, convex in it; the least is attained.
        low, high = np.zeros(rows.shape[:2]), np.ones(rows.shape[:2])
        for _ in range(_STEPS):
            first, second = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
            left = bound(first) <= bound(second)
            low, high = np.where(left, low, first), np.where(left, second, high)
        ends = [bound(np.full_like(low, w)) for w in (0.0, 1.0)]
        least = np.minimum(bound((low + high) / 2), np.fmin(*ends))
        return np.asarray(np.sqrt(least))

    def most_quadratic(self, forms: Values) -> Values:
        """Bound ``|x^T C x|`` over the motions x of each of the forms (N, n, d, d)."""
        forms = np.where(np.isfinite(forms), forms, 0.0)
        if not (self.speed and self.turning):
            spanned = self._spanned()
            if spanned is None:
                return np.zeros(forms.shape[:2])
            return _spectral(forms, spanned)
        root, share = self._joined()
        bounds = []
        for weight in _WEIGHTS:
            scale = np.sqrt(weight * share + (1 - weight) * (1 - share))
            bounds.append(_spectral(forms, root / scale[:, None, :]))
        return np.asarray(np.min(bounds, axis=0))

    def _spanned(self) -> Values | None:
        """Return S (N, d, 3), x = S u with |u| <= 1 being the motions of one size."""
        if self.speed:
            return self.speed * _least(self.point, self.length * self.turn)
        if self.turning:
            return self.turning * self.length * _least(self.length * self.turn, self.point)
        return None

    def _joined(self) -> tuple[Values, Values]:
        """Return T (N, d, d) and s (N, d): x = T z, |v|^2 the sum of s z^2, |w|^2 that of 1 - s.

        Sizes are taken for 1.
        """
        point, turn = self.point / self.speed, self.turn / self.turning
        first = product(np.swapaxes(point, 1, 2), point)
        values, vectors = eigen(first + product(np.swapaxes(turn, 1, 2), turn))
        small = values <= _RANK**2 * values[:, -1:]
        with np.errstate(divide="ignore"):
            root = vectors / np.sqrt(np.where(small, np.nan, values))[:, None, :]
        known = np.isfinite(root).all(axis=(1, 2))
        share = np.full(values.shape, np.nan)
        whole = np.full_like(root, np.nan)
        some = product(np.swapaxes(root[known], 1, 2), product(first[known], root[known]))
        share[known], turned = eigen((some + np.swapaxes(some, 1, 2)) / 2)
        whole[known] = product(root[known], turned)
        return whole, np.clip(share, 0.0, 1.0)


def _least(reached: Values, kept: Values) -> Values:
    """Return S (N, d, 3): x = S u has ``reached x = u`` for u in its range, and the least |kept x|.

    Both in one unit; u out of the range counts with its part in it.
    """
    size = np.linalg.norm(np.concatenate([reached, kept], axis=1), axis=(1, 2))
    inverse = _pseudo_inverse(reached, size)
    eye = np.eye(reached.shape[2])
    free = eye - product(inverse, reached)
    rest = _pseudo_inverse(product(kept, free), size)
    return product(eye - product(rest, kept), inverse)


def _pseudo_inverse(matrices: Values, size: Values) -> Values:
    """Return the pseudo-inverses, singular values of less than a share of a size taken for 0."""
    left, values, right = decomposed(np.nan_to_num(matrices))
    kept = values > _RANK * size[:, None]
    scale = np.where(kept, 1 / np.where(kept, values, 1.0), 0.0)
    return product(np.swapaxes(right, 1, 2) * scale[:, None, :], np.swapaxes(left, 1, 2))


def _spectral(forms: Values, maps: Values) -> Values:
    """Return the largest size of an eigenvalue of each form in the coordinates of a map."""
    known = np.isfinite(maps).all(axis=(1, 2))
    found = np.full(forms.shape[:2], np.inf)
    maps = maps[known][:, None]
    turned = product(np.swapaxes(maps, 2, 3), product(forms[known], maps))
    found[known] = np.abs(eigen((turned + np.swapaxes(turned, 2, 3)) / 2)[0]).max(axis=2)
    return found
