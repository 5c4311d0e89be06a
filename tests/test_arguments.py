"""Arguments of public functions: whatever is given in place of one, the answer is one line that names it."""

import inspect
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
import pytest
from drives import example
from pydantic import BaseModel
from typing_extensions import TypeAliasType

import warpchain
from warpchain import ArchiveOptions, Record, argument_checks, fit, modes, simulate
from warpchain.archive.read import Archive
from warpchain.drive import save_drive
from warpchain.errors import WarpchainError
from warpchain.modal.campbell import campbell, pitch_averaged_campbell
from warpchain.study.optimize import Optimizer, StudySession
from warpchain.study.spec import Study

PUBLIC = [getattr(warpchain, name) for name in warpchain.__all__ if name != "__version__"]
CLASSES = [*filter(inspect.isclass, PUBLIC), Archive, StudySession, Optimizer]
METHODS = [
    method
    for kind in CLASSES
    for name, method in vars(kind).items()
    if inspect.isfunction(method) and (name == "__getitem__" or not name.startswith("_"))
    if method.__module__.startswith("warpchain") and not hasattr(BaseModel, name)
    if len(inspect.signature(method).parameters) > 1
]
FUNCTIONS = [
    *filter(inspect.isfunction, PUBLIC),
    *(warpchain.ArchiveOptions, Record, warpchain.Wear),
    *(
        fit.fit_angle,
        fit.fit_links,
        fit.fit_position,
        fit.fit_wrap,
        fit.fit_indentation,
        save_drive,
        campbell,
        pitch_averaged_campbell,
    ),
    *METHODS,
]
CAR = example("car")
RIGHT = {
    "amplitude": 1e-4,
    "wrap": 60.0,
    "indentation": 0.01,
    "frequency": 10.0,
    "direction": (1, 0),
    "angle": {},
    "values": {},
    "variant": 0,
}
RIGHT |= {"drive": CAR, "drives": CAR, "self": CAR, "rows": [], "speeds": [0.0, 1.0], "count": 1}
RIGHT |= {"factor": abs, "rebound": abs, "title": "x", "end": 1.0, "over": "time"}
RIGHT |= {"table": pa.table({}), "design": pa.table({}), "number": 0, "metric": "x", "body": 0, "place": Path()}
RIGHT |= {
    "study": Study.model_construct(),
    "folder": type("StudyFolder", (str,), {})("x"),
}  # a folder of a study, or its path


@cache
def run():
    """A short run of one variant, recorded."""
    return simulate(CAR.with_values({"run.settle": False}), duration=1e-5, device="cpu", record=Record(variants=[0]))


def test_a_type_alias_is_what_it_stands_for():
    """NumPy's NDArray is one since 2.5, where Python has them."""
    scalar = TypeVar("scalar", bound=np.generic)
    array = TypeAliasType("array", np.ndarray[tuple[Any, ...], np.dtype[scalar]], type_params=(scalar,))
    for note in (array, array[np.float64]):
        words, test = argument_checks._kind_of_annotation(note)
        assert words == "a ndarray" and test(np.zeros(3)) and not test("x")


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__qualname__)
def test_an_argument_of_another_kind_is_named(function):
    names = inspect.signature(function).parameters
    right = RIGHT | {"run": run()}
    needed = {name: right.get(name, "x") for name, value in names.items() if value.default is value.empty}
    for name in names.keys() - {"self"}:
        with pytest.raises(WarpchainError, match=rf"^(\w+\.)?{name} = <object .*>: must be [^\n]+$"):
            function(**needed | {name: object()})


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: Record(variants=[0.5]), r"record.variants = \[0.5\]: must be 'all' or 'none' or a sequence, each a"),
        (lambda: Record(variants=["0"]), r"record.variants = \['0'\]: must be 'all' or"),
        (lambda: Record(rate=float("inf")), "record.rate = inf: must be a finite number above 0$"),
        (lambda: run()[True], "variant = True: must be a whole number"),
        (lambda: run().row_of(1), "variant 1: not in this run, whose 1 are 0"),
        (lambda: simulate([CAR, None]), r"drives = \[Drive\(.*, None\]: must be a Drive or a sequence, each a Drive"),
        (lambda: simulate(CAR, step=[1]), r"step = \[1\]: must be a finite number above 0 or 'auto'$"),
        (lambda: simulate(CAR, step=10**30), "step = 1000"),
        (lambda: simulate(CAR, window=(0.0, float("nan"))), r"window = \(0.0, nan\): must be 2 values, a finite"),
        (lambda: simulate(CAR, workers=10**9), "workers = 1000000000: must be a whole number from 1 to 1024"),
        (lambda: simulate(CAR, replicates=10**9), "replicates = 1000000000: must be a whole number from 1 to"),
        (lambda: CAR.with_values({1: 2.0}), "values = {1: 2.0}: must be a mapping from a text to anything"),
        (lambda: modes(CAR, count=0), "count = 0: must be a whole number of at least 1"),
        (lambda: modes(CAR, speed=float("nan")), "speed = nan: must be a finite number of at least 0"),
        (lambda: modes(CAR, valve="ajar"), "valve = 'ajar': must be 'shut' or 'open'"),
        (lambda: modes(CAR, speed=-3 * 0.003), "speed = -0.009: must be"),
        (lambda: modes(CAR, speed=np.float64(-3 * 0.003)), "speed = -0.009: must be"),
        (lambda: run()[0].at([0, 10**6]), r"frames of a trajectory of \d+: index 1000000 is out of bounds"),
        (lambda: ArchiveOptions(numbers=(1, 1)), "numbers: must be different from each other"),
    ],
)  # fmt: skip
def test_a_value_that_is_not_allowed_is_told(call, line):
    with pytest.raises(WarpchainError, match=f"^{line}"):
        call()


def test_numbers_and_arrays_of_numpy_are_allowed():
    record, duration = Record(np.arange(1, 2)), np.float32(1e-5)
    found = simulate([CAR] * 2, duration=duration, device="cpu", record=record, window=[0, 1e-5])
    assert list(found) == [1] and found[np.int64(1)] is found[1]
