"""Tensioners at rest: where their bodies stand, what oil they hold then, and what they push with while a chain settles.

At rest the check valve brings in what leaks, at the pressure P_r (`warpchain.drive.oil`). The oil's content is then
mu = phi(P_r) + ln(V / V_0) at the extension that the settled body gives (eq. (5), (6) of `kernels.physics.tensioner`),
and the ratchet is latched where it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.oil import EXPONENT
from warpchain.engine.packed import Packed


def tensioner_bodies(packed: Packed) -> NDArray[np.int64]:
    """(all tensioners,) which of all bodies each one pushes."""
    counts = packed.drives["tensioners"].astype(np.int64)
    first = np.repeat(packed.drives["first_body"].astype(np.int64), counts)
    return first + packed.tensioners["body"][: len(first)]


def extensions(packed: Packed) -> NDArray[np.float64]:
    """(all tensioners,) extension of each where its body stands [m]."""
    body = packed.bodies[tensioner_bodies(packed)]
    of = packed.tensioners[: len(body)]
    cosine, sine = np.cos(body["angle"])[:, None], np.sin(body["angle"])[:, None]
    point = of["point"]
    arm = point * cosine + np.stack([-point[:, 1], point[:, 0]], axis=1) * sine
    return np.einsum("ti,ti->t", body["center"] + arm - of["home"], of["direction"])


def compression(pressure: NDArray[np.float64], of: NDArray[Any]) -> NDArray[np.float64]:
    """phi(P) of oil with air, eq. (5)."""
    gas = of["air"] * (of["ambient"] / pressure) ** (1.0 / EXPONENT)
    return (pressure / of["bulk_modulus"] - gas) / (1.0 + of["air"])


def lay_to_rest(packed: Packed) -> None:
    """Gives every tensioner of an ensemble the state that it has at rest where its body stands now."""
    x = extensions(packed)
    of, oil = packed.tensioners[: len(x)], packed.oil[: len(x)]
    oil["farthest"] = x
    oil["pressure"] = of["ambient"]
    wet = of["hydraulic"] == 1
    oil["pressure"][wet] = of["rest"][wet]
    volume = 1.0 + of["area"][wet] * np.maximum(x, of["bottom"])[wet] / of["volume"][wet]
    oil["content"][wet] = compression(of["rest"][wet], of[wet]) + np.log(volume)


def springs(tensioners: NDArray[Any]) -> NDArray[Any]:
    """Tensioners that push with what they push with at rest: as springs, without dampers and ratchets."""
    slow = tensioners.copy()
    wet = slow["hydraulic"] == 1
    slow["preload"][wet] += ((slow["rest"] - slow["ambient"]) * slow["area"])[wet]
    for name in ("hydraulic", "damping", "stop_damping", "ratchet_pitch"):
        slow[name] = 0
    slow["bottom"] = np.where(wet, slow["bottom"], -np.inf)
    return slow
