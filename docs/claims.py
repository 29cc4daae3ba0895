"""What the 2UU-UPU paper says of its motion, against the motion itself: one line a claim.

Run: python docs/claims.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import pmopt
from pmopt.analysis.motion import Motion

MOTIONS = Path(__file__).resolve().parents[1] / "configs" / "motion"


def euler_rates(motion: Motion) -> str:
    """Compare (gamma', beta', alpha'), which the paper calls the angular velocity, with it."""
    omega = motion.angular[:, 0]
    beta, gamma = motion.pose.rates[:, 1], motion.pose.rates[:, 2]
    alpha = motion.parasitic.rates[:, 2]
    gap = np.linalg.norm(omega - np.stack([gamma, beta, alpha], axis=1), axis=1).max()
    largest = np.linalg.norm(omega, axis=1).max()
    return (
        f"Euler rates as angular velocity: {1e3 * gap:.2f} mrad/s off, {100 * gap / largest:.1f} % "
        "of the largest"
    )


def link_angles(motion: Motion) -> tuple[str, str]:
    """Check (10) and (11) for the UU links, whose direction cosines the motion tells."""
    phi = motion.joints.values[:, 1]
    swings = {2: motion.passive.values[:, 2], 3: motion.joints.values[:, 2]}
    excess, height = [], []
    for swing in swings.values():
        u = np.stack([np.sin(phi) * np.cos(swing), np.sin(swing), np.cos(phi) * np.cos(swing)])
        cos_i, cos_ii = u[0], u[1]
        sines = np.sqrt((1 - cos_i**2) * (1 - cos_ii**2))
        # (10): cos^2 theta_i + cos^2 theta_ii + sin^2 theta_i sin^2 theta_ii = 1
        excess.append((cos_i**2 + cos_ii**2 + sines**2 - 1).max())
        # (11) differentiates z_c = l/2 sin theta_i sin theta_ii
        height.append(np.abs(motion.params["L"] / 2 * (sines - u[2])).max())
    return (
        f"(10): the sum of squares exceeds l^2 by up to {100 * max(excess):.1f} %",
        f"(11): its z_c is off by up to {1e3 * max(height):.1f} mm",
    )


def printed_trajectory() -> str:
    """Run (16) as printed."""
    run = pmopt.motion(MOTIONS / "2uu-upu-eq16.toml")
    instants = f"{run.infeasible_instants} of {len(run.motion.t)} instants"
    return f"(16) as printed: {instants} are infeasible"


def main() -> None:
    """Print every claim."""
    motion = pmopt.motion(MOTIONS / "2uu-upu-t1.toml").motion
    for line in (euler_rates(motion), *link_angles(motion), printed_trajectory()):
        print(line)


if __name__ == "__main__":
    main()
