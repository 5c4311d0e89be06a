"""The JSON of `check --json` and `run --json`, by `warpchain.cli.output_schema`."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from warpchain.cli.output_schema import FORMAT

if TYPE_CHECKING:
    from pathlib import Path

    from warpchain.drive import Drive
    from warpchain.results.run import RunInfo


def json_text(values: Mapping[str, Any]) -> str:
    """Text of a JSON object; numbers that are not finite are null."""
    return json.dumps(_finite_json(values), indent=2, allow_nan=False, ensure_ascii=False)


def _finite_json(value: Any) -> Any:
    """JSON value with None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {key: _finite_json(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite_json(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def check_values(drive: Drive, name: str, defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Values of `check --json` on a drive.

    Args:
        name: of its file or example.
        defaults: what the file leaves out, by key path.
    """
    from warpchain.assembly.summary import derived_quantities
    from warpchain.version import installed_version

    head = {"format": FORMAT, "version": installed_version(), "units": "SI", "drive": name, "defaults": defaults}
    return head | derived_quantities(drive)


def run_values(drive: Drive, metrics: Mapping[str, Any], info: RunInfo, archive: Path | None) -> dict[str, Any]:
    """Values of `run --json` beside those of `check --json`.

    Args:
        metrics: the row of the run.
    """
    from warpchain.results.losses import loss_shares

    made = {key: getattr(info, key) for key in ("ended", "device", "precision", "step", "created", "wall_time")}
    return {
        "run": made | {"archive": None if archive is None else str(archive)},
        "status": metrics["status"],
        "reasons": metrics["reason"].split("; ") if metrics["reason"] else [],
        "losses": {group: loss._asdict() for group, loss in loss_shares(drive, metrics).items()},
        "metrics": {name: value for name, value in metrics.items() if name not in ("variant", "status", "reason")},
    }
