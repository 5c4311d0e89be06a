"""Shared by the tests of studies: a drive that simulates in milliseconds, and a study of it, whatever its energy."""

from layouts import Placed, drive_of
from pyarrow import parquet

from warpchain.drive import dumps_drive

STUDY = """
[study]
drive = "tiny.toml"

[design]
kind = "factorial"

[[factors]]
name = "torque"
path = "sprockets.s1.load.torque"
range = [0.0, 1.0]
points = {points}

[[factors]]
name = "links"
path = "chain.links"
levels = [44, 45]

[limits]
energy_residual = inf
energy_change = inf

[run]
duration = 0.0005
step = 1e-5
shard = {shard}
"""
LIMITS = "[limits]\nenergy_residual = inf\nenergy_change = inf\n"
LINKS = '[[factors]]\nname = "links"\npath = "chain.links"\nlevels = [44, 45]\n'
SAMPLED = STUDY.replace('kind = "factorial"', 'kind = "sobol"\ncount = 4')
SAMPLED = SAMPLED.replace("range = [0.0, 1.0]\npoints = {points}", "range = [0.0, 20.0]")
"""Four points of torque and links."""
NOISY = STUDY.replace('kind = "factorial"', 'kind = "noise"').replace(LINKS, "").replace("0.0005", "0.0003")
NOISY = NOISY.replace(
    "range = [0.0, 1.0]\npoints = {points}", 'kind = "noise"\ndistribution = "normal"\nmean = 5.0\nstd = 1.0'
)
"""A torque that is noise, in runs that are shorter."""


def tiny_drive():
    """Two sprockets of 12 teeth, 44 links fit with a strain of -1.6 %, 42 to 45 within 5 %."""
    return drive_of([Placed(12, (0.0, 0.0)), Placed(12, (0.2, 0.0))], 44)


def write_study(folder, more="", points=6, shard=2, text=STUDY):
    """Writes the drive and the study file; returns the study file's path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "tiny.toml").write_text(dumps_drive(tiny_drive()))
    path = folder / "study.toml"
    path.write_text(text.format(points=points, shard=shard) + more)
    return path


def rows_of(folder, *left_out, name="results"):
    """The rows of a table, but for where their recordings are and columns that begin as `left_out`."""
    rows = parquet.read_table(folder / f"{name}.parquet").to_pylist()
    return [{key: value for key, value in row.items() if not key.startswith(("archive", *left_out))} for row in rows]
