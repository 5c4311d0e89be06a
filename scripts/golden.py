"""Guard of a redesign: what the project computes stays bitwise the same.

    python scripts/golden.py                    # runs every case, stores what it gives in out/golden
    python scripts/golden.py --compare          # runs every case again, compares bit by bit; status 1 on a difference
    python scripts/golden.py --compare --only marine laws

What a case gives beyond what is stored, such as new columns of metrics, is named and is no difference.

Together the cases exercise everything but figures: drives, contacts, mounts, tables, both integrators and precisions,
the CPU kernel and, on fibers, the GPU's block kernel, archives, studies, and what is read off a recorded run. Results
hold for one machine and one version of Warp and numpy, so they are made anew and not committed. CONTRIBUTING.md has how
to compare with an older commit, by that tree's own script.

The first line printed tells which tree's package ran. The cases are in `golden_runs/cases.py` and `blocks.py`, their
drives in `drives.py`; when a redesign moves modules, only the imports of these three follow.
"""

import argparse
import ast
import dataclasses
import sys
import tempfile
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import warp as wp
from common.cases import described_parser
from golden_runs.cases import CASES

import warpchain
from warpchain import Run, Trajectory


def value_parts(value: Any) -> dict[Any, Any] | None:
    """The parts of a value, by name; None if it is a leaf."""
    if isinstance(value, Run):
        return {"metrics": value.metrics, "ended": value.info.ended, "run": dict(value.items())}
    if isinstance(value, Trajectory):
        return {"drive": warpchain.dumps_drive(value.drive), "time": value.time, **value.channels()}
    if isinstance(value, pa.Table):
        fields = {f.name: f"{f.type} {f.nullable} {f.metadata}" for f in value.schema}
        columns = {name: column_values(value[name]) for name in value.column_names}
        return {"columns": columns, "fields": fields, "names": repr((value.column_names, value.schema.metadata))}
    if dataclasses.is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, np.ndarray) and value.dtype.names:
        return {name: value[name] for name in value.dtype.names}
    if isinstance(value, list | tuple):
        return dict(enumerate(value))
    return value if isinstance(value, dict) else None


def column_values(values: pa.ChunkedArray) -> Any:
    """A table's column: numbers and where there are none, or else its text."""
    if pa.types.is_integer(values.type) or pa.types.is_floating(values.type):
        return {"value": values.fill_null(0).to_numpy(), "null": values.is_null().to_numpy()}
    return repr(values.to_pylist())


def flat_arrays(value: Any, name: str = "") -> dict[str, np.ndarray]:
    """Arrays by name; text as bytes.

    Raises:
        TypeError: what is no array.
    """
    value = value.numpy() if isinstance(value, wp.array) else value
    inner = value_parts(value)
    if inner is not None:
        each = (flat_arrays(part, f"{name}/{key}".removeprefix("/")) for key, part in inner.items())
        return {key: array for part in each for key, array in part.items()}
    if value is None or isinstance(value, str):
        value = str(value).encode()
    array = np.frombuffer(value, dtype=np.uint8) if isinstance(value, bytes) else np.asarray(value)
    if array.dtype == object:
        raise TypeError(f"{name}: {type(value).__name__} is no array")
    return {name: array}


def array_difference(old: np.ndarray, new: np.ndarray) -> str:
    """The difference of two arrays, "" if not in a single bit."""
    if (old.dtype, old.shape) != (new.dtype, new.shape):
        return f"{new.dtype}{list(new.shape)} instead of {old.dtype}{list(old.shape)}"
    bits = [np.frombuffer(a.tobytes(), dtype=np.uint8).reshape(a.size, -1) for a in (old, new) if a.size]
    count = int((bits[0] != bits[1]).any(axis=1).sum()) if bits else 0
    if not count:
        return ""
    with np.errstate(invalid="ignore"):
        apart = np.abs(new.astype(float) - old.astype(float)) if new.dtype.kind in "biuf" else np.zeros(0)
    largest = float(np.max(apart[np.isfinite(apart)], initial=0.0))
    return f"{count} of {new.size} values, largest difference {largest:.3g}"


def are_only_added(name: str, old: np.ndarray, new: np.ndarray) -> bool:
    """Whether the names of a table's columns (`value_parts`) are what they were but for further ones among them."""
    if not name.endswith("names"):
        return False
    (before, facts), (after, new_facts) = (ast.literal_eval(names.tobytes().decode()) for names in (old, new))
    rest = iter(after)
    return facts == new_facts and all(column in rest for column in before)


def first_names(found: Sequence[str]) -> str:
    """The first five of them, and how many more there are."""
    return "; ".join(found[:5]) + (f"; and {len(found) - 5} more" if len(found) > 5 else "")


def case_difference(path: Path, new: dict[str, np.ndarray]) -> tuple[str, str]:
    """The difference of a case from what is stored, "" if not in a single bit; and what it has beyond that."""
    if not path.exists():
        return f"missing: {path}", ""
    with np.load(path) as old:
        found = [f"{name} is missing" for name in old.files if name not in new]
        pairs = [(name, array_difference(old[name], new[name])) for name in new if name in old.files]
        found += [f"{name}: {text}" for name, text in pairs if text and not are_only_added(name, old[name], new[name])]
        added = [name for name in new if name not in old.files]
    return first_names(found), first_names(added)


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = described_parser(__doc__)
    made.add_argument("--compare", action="store_true", help="compare with what is stored")
    made.add_argument("-o", "--output", metavar="DIR", type=Path, default=Path("out/golden"), help="the store")
    made.add_argument("--only", nargs="+", metavar="NAME", choices=CASES, default=list(CASES), help="cases to run")
    return made


def main(words: Sequence[str] | None = None) -> int:
    """Runs the cases; returns the exit status."""
    arguments = parser().parse_args(words)
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    print(f"warpchain of {Path(warpchain.__file__).parent}", flush=True)
    arguments.output.mkdir(parents=True, exist_ok=True)
    failed = 0
    for name in arguments.only:
        begun, path = time.perf_counter(), arguments.output.resolve() / f"{name}.npz"
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            arrays = flat_arrays(CASES[name](Path(folder)))
        line = f"stored {len(arrays)} arrays"
        if arguments.compare:
            differs, added = case_difference(path, arrays)
            failed += bool(differs)
            line = (differs or "same") + (f"; added: {added}" if added else "")
        else:
            np.savez(path, **dict[str, Any](arrays))
        print(f"{name:14s} {time.perf_counter() - begun:6.1f} s  {line}", flush=True)
    gone = sorted({path.stem for path in arguments.output.glob("*.npz")} - set(CASES)) if arguments.compare else []
    for name in gone:
        print(f"{name:14s}           stored, but no case any more")
    return 1 if failed or gone else 0


if __name__ == "__main__":
    sys.exit(main())
