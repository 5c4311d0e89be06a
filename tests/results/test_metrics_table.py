"""The table of metrics of many variants at once: each row is what the variant has alone."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from drives import two_sprockets

from warpchain.drive import Drive
from warpchain.kernels import relaxation, structs
from warpchain.kernels.statistics import BATCHES
from warpchain.model import single_chain
from warpchain.results import metrics
from warpchain.results.metric_columns import variants_by_columns
from warpchain.results.metric_formulas import BatchSums, VariantSums
from warpchain.results.metrics import VariantEnds, _arrow_column, energy_balance, metric_blocks, metrics_table
from warpchain.results.schedule import Schedule

STRUCTS = {
    "chain": structs.ChainSums,
    "strand": structs.StrandSums,
    "sprocket": structs.SprocketSums,
    "mount": structs.MountSums,
    "contact": structs.ContactSums,
    "slip": structs.SlipSums,
}
BATCHED = {name: STRUCTS[name] for name in ("chain", "strand", "sprocket", "mount")}
SHAKEN = {"kind": "prescribed", "direction": [0.0, 1.0], "amplitude": 1e-4, "frequency": 40.0}


def drives() -> list[Drive]:
    """Three kinds: as it is, one that settles, one with a moving sprocket."""
    plain = two_sprockets(settle="false")
    moving = plain.with_values({"sprockets.driver.mount": SHAKEN})
    return [plain, two_sprockets(), moving, plain, moving, plain, two_sprockets(), moving]


def sums_of(drive: Drive, variant: int) -> dict[str, np.ndarray]:
    """Made-up sums of one variant: some strands without links, a sprocket that stands still; one in two turns far."""
    random = np.random.default_rng(variant)
    sprockets = len(drive.sprockets)
    counts = {"chain": 1, "contact": sprockets + len(drive.guides)}
    made = {}
    for name, struct in STRUCTS.items():
        rows = np.zeros(counts.get(name, sprockets), struct.numpy_dtype())
        for field in rows.dtype.names:
            rows[field] = random.integers(0, 3, rows[field].shape) * random.uniform(0.5, 2.0, rows[field].shape)
        made[name] = rows
    made["chain"] = made["chain"][0]
    made["sprocket"]["speed"] *= 400.0 if variant % 2 else 1.0
    made["tension"] = random.integers(0, 5, (sprockets + 1, 6))
    made["edges"] = np.sort(random.normal(size=7))
    made["durations"] = random.uniform(0.5, 2.0, int(BATCHES))
    for name, struct in BATCHED.items():
        shape = (int(BATCHES),) if name == "chain" else (sprockets, int(BATCHES))
        rows = np.zeros(shape, struct.numpy_dtype())
        made[f"{name}_batches"] = {f: random.uniform(0.5, 2.0, rows[f].shape) for f in rows.dtype.names}
    return made


def table_of(chosen: list[int]) -> pa.Table:
    """The table of some of the drives; the third has diverged, the sixth was interrupted."""
    every = drives()
    settled = np.zeros(len(every), relaxation.Settling.numpy_dtype())
    settled["steps"], settled["residual"] = np.arange(len(every)), np.linspace(0.0, 1.0, len(every))
    schedules = [Schedule(1e-6 * (v + 1), 100, 50, 100, 0) for v in chosen]
    steps = np.array([101, 101, 70, 101, 101, 80, 101, 101])[chosen]
    mine = [every[v] for v in chosen]
    ended = VariantEnds(mine, schedules, steps, np.array(chosen) == 2, settled[chosen])
    chains = replace(ended, drives=list(map(single_chain, mine)))

    def stacked(numbers: np.ndarray) -> VariantSums:
        each = [sums_of(mine[n], chosen[n]) for n in numbers]
        names = (*STRUCTS, "tension", "edges", "durations")
        stacked = {name: np.stack([sums[name] for sums in each]) for name in names}
        batches = {}
        for name in BATCHED:
            mine_ = [sums[f"{name}_batches"] for sums in each]
            batches[name] = {field: np.stack([rows[field] for rows in mine_]) for field in mine_[0]}
        tension = stacked.pop("tension"), stacked.pop("edges")
        batched = BatchSums(batches, stacked.pop("durations"))
        return VariantSums(stacked, batched, batched, tension)

    return metrics_table(
        ended, metric_blocks(ended, lambda variants: [(chains.select_variants(variants), stacked(variants))])
    )


def held(row):
    """The values that a row has."""
    return {name: value for name, value in row.items() if value is not None}


def test_a_row_of_many_is_the_row_alone():
    many = table_of(list(range(8))).to_pylist()
    for v, row in enumerate(many):
        alone = table_of([v]).to_pylist()[0] | {"variant": v}
        assert held(row) == held(alone)
    assert [row["diverged"] for row in many] == [v == 2 for v in range(8)]
    assert many[2]["diverged_time"] == 70 * 3e-6
    assert many[2]["tension_mean"] is None and many[5]["tension_mean"] is None
    errors = {row.get("tension_mean_se") is not None for row in many}
    assert errors == {False, True}  # which only those have whose chains turn often enough


def test_variants_are_worked_on_a_block_at_a_time(monkeypatch):
    whole = table_of(list(range(8)))
    monkeypatch.setattr(metrics, "LARGEST_STACK", 2)
    assert table_of(list(range(8))).equals(whole, check_metadata=True)


def test_rows_of_what_they_have_are_the_table_again():
    table = table_of(list(range(8)))
    again = metrics.table_from_rows(list(map(held, table.to_pylist())))
    assert set(again.column_names) == set(table.column_names)
    assert again.equals(table.select(again.column_names))


def test_columns_stand_where_the_first_variant_has_them():
    """Row by row, what a variant has and no one before it had comes after what was there."""
    names: dict[str, None] = {}
    for v in range(8):
        names |= dict.fromkeys(table_of([v]).column_names)
    assert table_of(list(range(8))).column_names == list(names)
    assert "settle_steps" in names


def test_sums_over_many_partners_go_as_for_one():
    """With 8 partners and more numpy adds up in pairs: along a variant's own, whatever the number of variants."""
    drive, random = drives()[0], np.random.default_rng(0)
    sums = {name: np.zeros((50, *([13] * (name != "chain"))), STRUCTS[name].numpy_dtype()) for name in STRUCTS}
    sums["contact"]["dissipated"] = random.normal(size=(50, 13))
    mine = {name: rows if name in ("chain", "contact") else rows[:, :2] for name, rows in sums.items()}
    found = energy_balance(single_chain(drive), mine)
    assert found.dissipated.tolist() == [row["dissipated"].sum() for row in sums["contact"]]


def test_kinds_go_by_columns():
    every = drives()
    assert [kind.tolist() for kind in variants_by_columns(every)] == [[0, 3, 5], [1, 6], [2, 4, 7]]
    longer = every[0].with_values({"run.duration": 9.0})
    assert len(variants_by_columns([every[0], longer])) == 1


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (float, np.array([1.5, np.nan, -0.0, np.inf, 2.0, 3.0, 4.0, 5.0, 6.0])),
        (float, np.arange(10.0)[::2]),
        (int, np.array([1, -(2**62), 3], dtype=np.int64)),
        (int, np.array([1, 2, 3], dtype=np.int32)),
        (bool, np.arange(19) % 3 == 0),
        (float, np.zeros(0)),
    ],
)
def test_columns_are_what_pyarrow_makes_of_them(kind, values):
    for missing in (np.zeros(len(values), dtype=bool), np.arange(len(values)) % 2 == 0):
        column = _arrow_column(kind, values, missing)
        column.validate(full=True)
        assert column.equals(pa.array(values, type=column.type, mask=missing)) or np.isnan(values).any()
        told, plain = column.to_pylist(), pa.array(values, type=column.type, mask=missing).to_pylist()
        assert list(map(repr, told)) == list(map(repr, plain))  # so that nan is nan, and -0.0 is that


@pytest.mark.parametrize("words", [[], ["ok"], ["ok", "", "Spannräder – größer", "diverged"], ["ok", None]])
def test_columns_of_texts_are_what_pyarrow_makes_of_them(words):
    column = _arrow_column(str, words, None)
    column.validate(full=True)
    assert column.equals(pa.array(words, pa.string()))


@pytest.mark.parametrize("rows", [[0, 1, 2, 3], [3, None, 2], [2, 3], [None, 1], [0, 0, None, 3]])
def test_rows_gathered_from_a_table_are_those_made_of_them_one_by_one(rows):
    """Variant 2 lacks what variant 3 has, and one without metrics comes between: order, nulls and units are alike."""
    names = ("variant", "status", "tension_mean", "a.torque_mean", "slips", "b.torque_mean")
    values = [
        (0, "ok", 1.5, None, 2, None),
        (1, "suspect", 2.5, 3.0, None, None),
        (2, "ok", None, None, 1, None),
        (3, "ok", 4.5, -1.0, 0, 0.5),
    ]
    given = [held(dict(zip(names, row, strict=True))) for row in values]
    table = metrics.table_from_rows(given)
    kept = {"tension_mean", "a.torque_mean", "b.torque_mean"}
    parts = [{name: value for name, value in row.items() if name in kept} for row in given]
    one_by_one = metrics.table_from_rows([{} if row is None else parts[row] for row in rows])
    found = metrics.select_metrics(table, rows, kept.__contains__)
    assert found.equals(one_by_one.drop_columns("variant"), check_metadata=True)
