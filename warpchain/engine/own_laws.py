"""Contact laws of plug-ins: tried, and added to kernels' before these are made."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from typing import Any

import numpy as np
import warp as wp

from warpchain.drive.laws import LAWS, LAWS_IN_USE, Law
from warpchain.drive.plugins import LOADING_SECONDS, digest_of_file, plugin_code
from warpchain.errors import PluginError
from warpchain.kernels.cpu.law_trial import TriedForce, law_trial_kernel
from warpchain.kernels.physics import impact

TRIED = np.array([[e, v, d] for e in (1e-3, 1.0, 1e3, 1e6) for v in (1e-6, 0.01, 1.0, 30.0) for d in (0.0, 0.1, 2.0)])
"""Elastic forces [N], impact speeds [m/s] and dampings that try a plug-in's law."""
KERNEL_FACTORIES = {
    "cpu.advance": "advance_kernel",
    "cpu.relax": "relax_kernel",
    "gpu.block": "block_kernel",
    "gpu.relax": "block_relax_kernel",
    "gpu.statistics": "tally_sum_kernel",
}
"""Cached kernel factories whose digests have contact laws."""


def form_of_law(law: Law) -> int:
    """Number of a contact law (`structs.ContactLaw.form`); adds a plug-in's."""
    if isinstance(law.force, str):
        return next(form for form, force in enumerate(impact.FORCES) if force.key == law.force)
    if law.force not in impact.FORCES:
        _add_force(law.force)
    return impact.FORCES.index(law.force)


def add_laws(names: Iterable[str] | None = None) -> None:
    """Adds plug-ins' contact laws to kernels', by default those of all drives so far.

    Raises:
        PluginError: a law that Warp cannot compile, or with invalid values.
    """
    for name in LAWS_IN_USE if names is None else names:
        form_of_law(LAWS[name])


def added_laws() -> tuple[str, ...]:
    """Names of plug-ins' contact laws in kernels, in order."""
    names = {id(law.force): name for name, law in LAWS.items()}
    return tuple(names[id(force)] for force in impact.FORCES if id(force) in names)


def _add_force(force: Any) -> None:
    """Adds a contact law's function to kernels'; forgets earlier kernels."""
    code = force.func.__code__
    digest = digest_of_file(code.co_filename)
    force.adj.source += f"\n# {digest}"  # kernels' digests have the laws' sources: functions that it calls count, too
    for real in (wp.float64, wp.float32):
        try:
            with plugin_code(code.co_filename, "", LOADING_SECONDS):
                _try_force(force, real)
        except PluginError as error:
            raise PluginError(_law_error(str(error), force)) from None
    impact.FORCES = (*impact.FORCES, force)
    impact.law_damper = wp.func(impact.law_damper.func)  # whose loop over the laws Warp unrolls where it is declared
    forget_kernels()


def forget_kernels() -> None:
    """Forgets kernels with contact laws, to be made anew."""
    for module, name in KERNEL_FACTORIES.items():
        made = sys.modules.get(f"warpchain.kernels.{module}")
        if made is not None:
            getattr(made, name).cache_clear()


def _law_error(said: str, force: Any) -> str:
    """Message on a contact law's function, with Warp's line."""
    code = force.func.__code__
    line, reason = code.co_firstlineno, said.removeprefix(": ")
    for name, number in re.findall(rf'function "(\w+)" at {re.escape(code.co_filename)}:(\d+):', said):
        inner = getattr(force.func.__globals__.get(name), "func", force.func)
        line, first = int(number), inner.__code__.co_firstlineno
        line += first if line < first else 0  # of functions of any type Warp counts from their first
        reason = said.rpartition(";")[2]
    return f"{code.co_filename}, line {line}: {reason}"


def _try_force(force: Any, real: Any) -> None:
    """Compiles a contact law's function for the CPU; PluginError for bad values."""
    given: wp.array = wp.array(TRIED, dtype=real, device="cpu")
    found: wp.array = wp.zeros(TRIED.shape, dtype=real, device="cpu")
    wp.launch(
        law_trial_kernel(TriedForce(force.adj.source, force), real), len(TRIED), inputs=[given, found], device="cpu"
    )
    for (elastic, speed, damping), (damper, slowest, fastest) in zip(TRIED, found.numpy(), strict=True):
        if not (0.0 <= damper < np.inf and slowest <= fastest):
            raise PluginError(
                f"with an elastic force of {elastic:g} N, an impact at {speed:g} m/s and a damping of {damping:g} it "
                f"gives {damper:g}, {slowest:g}, {fastest:g}; must be a damper of at least 0 and bounds in order"
            )
