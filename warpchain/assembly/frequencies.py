"""First transverse frequencies of strands: of the chain at rest, link by link, and of a string that travels.

A string of tension T (all of it, centrifugal part included) and mass m / p a length carries waves at the speed
c = sqrt(T p / m) along the chain, which itself travels with v: c + v one way and c - v the other. A wave of mode n goes
round a strand of length L in the time L/(c + v) + L/(c - v), of which there are n periods:

    f_n = n (c^2 - v^2) / (2 L c)                                                                          (a)

(Sack 1954). At rest the chain's rollers lower that a little: f_1 = (1/pi) sqrt(T / (m p)) sin(pi / (2 (M + 1))) with M
rollers between fixed ends, (b).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from warpchain.drive import Drive


def strand_frequency(drive: Drive, links: int, tension: float) -> float:
    """First transverse frequency of a strand of `links` links at rest, its ends fixed [Hz], 0 without tension; (b)."""
    if tension <= 0.0 or links < 2:
        return 0.0
    rate = math.sqrt(tension / (drive.chain.mass * drive.chain.pitch))
    return rate / math.pi * math.sin(math.pi / (2.0 * links))


def moving_frequency(drive: Drive, length: float, tension: float, speed: float, mode: int = 1) -> float:
    """Transverse frequency of a strand that travels, its ends fixed [Hz]; (a).

    Args:
        drive: the drive.
        length: L of the strand [m].
        tension: T, centrifugal part included [N].
        speed: v of the chain [m/s].
        mode: n, from 1.

    Returns:
        f_n; 0 where the tension is no more than the centrifugal part, so that waves do not outrun the chain.
    """
    square = max(tension, 0.0) * drive.chain.pitch / drive.chain.mass
    if square <= speed * speed:
        return 0.0
    wave = math.sqrt(square)
    return mode * (square - speed * speed) / (2.0 * length * wave)
