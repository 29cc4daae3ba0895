"""Finite motion of limbs that meet in one platform: steps, and Newton's method back on closure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pmopt.analysis.mobility import screws
from pmopt.analysis.mobility.screws import IDENTITY, Displacement, compose, small
from pmopt.mechanisms.mechanism import Chain, Matrix, Vector

#: Largest misfit of limbs that counts as closed, in scaled lengths and radians.
CLOSED = 1e-12
_STEPS = 60
#: A correction longer than this has left the neighbourhood of the step.
_LONGEST = 0.7
#: Singular values of the closure below this share are left out of a correction.
_CUT = 1e-7


@dataclass(frozen=True)
class Assembly:
    """Limbs at one configuration, in scaled lengths, and how far each has moved its end."""

    chains: tuple[Chain, ...]
    ends: tuple[Displacement, ...]

    @classmethod
    def of(cls, chains: Sequence[Chain]) -> Assembly:
        """Return the assembly at its declared configuration."""
        return cls(tuple(chains), (IDENTITY,) * len(chains))

    @property
    def counts(self) -> list[int]:
        """Elementary freedoms of each limb."""
        return [screws.freedoms(chain) for chain in self.chains]

    def closure(self) -> Matrix:
        """Return the loops' Jacobian, (6 (limbs - 1), freedoms): limb 1 less each other."""
        counts = self.counts
        rows, columns = 6 * (len(counts) - 1), sum(counts)
        matrix = np.zeros((rows, columns))
        start = counts[0]
        first = screws.limb_twists(self.chains[0])
        for i, chain in enumerate(self.chains[1:]):
            block = slice(6 * i, 6 * i + 6)
            matrix[block, : counts[0]] = first
            matrix[block, start : start + counts[i + 1]] = -screws.limb_twists(chain)
            start += counts[i + 1]
        return matrix

    def misfit(self) -> Vector:
        """Return the twists that take the end of limb 1 to that of each other limb."""
        back = screws.inverse(self.ends[0])
        gaps = [small(compose(end, back)) for end in self.ends[1:]]
        return np.concatenate(gaps) if gaps else np.zeros(0)

    def moved(self, q: Vector) -> Assembly:
        """Return the assembly with every joint moved; it need not close."""
        chains, ends, start = [], [], 0
        for chain, end, count in zip(self.chains, self.ends, self.counts, strict=True):
            new, displacement = screws.move(chain, q[start : start + count])
            chains.append(new)
            ends.append(compose(displacement, end))
            start += count
        return Assembly(tuple(chains), tuple(ends))

    def joint_step(self, twist: Vector) -> Vector:
        """Return the smallest joint rates that move every limb's end by a twist."""
        return np.concatenate(
            [np.linalg.lstsq(screws.limb_twists(c), twist, rcond=None)[0] for c in self.chains]
        )

    def freedom(self) -> Matrix:
        """Return the platform's twists."""
        return platform_twists(self.chains)

    def closed(self) -> Assembly | None:
        """Return the nearest closed assembly by Newton's method; None where it finds none."""
        current = self
        for _ in range(_STEPS):
            misfit = current.misfit()
            if np.abs(misfit).max(initial=0.0) < CLOSED:
                return current
            step = np.asarray(np.linalg.lstsq(current.closure(), misfit, rcond=_CUT)[0], float)
            if not np.abs(step).max() < _LONGEST:
                return None
            current = current.moved(step)
        return None

    def walked(self, rng: np.random.Generator, steps: int, size: float) -> Assembly:
        """Return the assembly after a random walk in the null space of the closure.

        Every step is projected back on closure; one that cannot be is halved.
        """
        current = self
        heading = rng.normal(size=sum(self.counts))
        for _ in range(steps):
            free = screws.null(current.closure())
            if not free.shape[1]:
                return current
            # Onwards, with some turning.
            heading = free @ (free.T @ (heading + 0.5 * rng.normal(size=heading.size)))
            heading /= np.linalg.norm(heading)
            length = size * rng.uniform(0.5, 1.5)
            for _ in range(6):
                new = current.moved(length * heading).closed()
                if new is not None:
                    current = new
                    break
                length /= 2
        return current

    def kept(self, rng: np.random.Generator, size: float = 1e-2) -> int:
        """Return how many of the platform's freedoms survive in finite motion.

        A step along each of its twists, in a random basis, is projected back on closure; what
        the platform has moved then is compared with the step.
        """
        basis = self.freedom()
        count = basis.shape[1]
        if not count:
            return 0
        basis = basis @ np.linalg.qr(rng.normal(size=(count, count)))[0]
        back = screws.inverse(self.ends[0])
        reached = []
        for twist in basis.T:
            for length in (size, size / 10):
                new = self.moved(length * self.joint_step(twist)).closed()
                if new is not None:
                    reached.append(small(compose(new.ends[0], back)) / length)
                    break
        if not reached:
            return 0
        values = np.linalg.svd(np.array(reached), compute_uv=False)
        return int((values > 0.5).sum())


def platform_twists(chains: Sequence[Chain]) -> Matrix:
    """Return the twists every limb allows: the null space of all their wrenches."""
    wrenches = [screws.reciprocal(screws.limb_twists(chain)) for chain in chains]
    return screws.reciprocal(screws.span(np.hstack(wrenches)))


def follow(chain: Chain, end: Displacement, goal: Displacement) -> tuple[Chain, Displacement]:
    """Return a limb moved so that its end comes as near to a displacement as it can.

    Gauss-Newton; a limb of less than six freedoms reaches only what its constraints allow.
    """
    for _ in range(25):
        error = small(compose(goal, screws.inverse(end)))
        if np.abs(error).max() < CLOSED:
            break
        step = np.linalg.lstsq(screws.limb_twists(chain), error, rcond=_CUT)[0]
        longest = np.abs(step).max()
        chain, displacement = screws.move(chain, step * min(1.0, _LONGEST / max(longest, 1e-300)))
        end = compose(displacement, end)
        if longest < 1e-14:
            break
    return chain, end
