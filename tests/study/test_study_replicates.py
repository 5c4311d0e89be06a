"""Studies that run each row several times: means, errors and n of the copies, recorded copies, killed and gone on."""

import numpy as np
import pytest
from command import refused, run
from pyarrow import parquet
from study_helpers import STUDY, tiny_drive, write_study

from warpchain import Limits, Record, read_archive, simulate
from warpchain.errors import StudyError
from warpchain.study.results import read_results
from warpchain.study.run import run_study, study_status
from warpchain.study.spec import loads_study

SEVERAL = STUDY.replace('kind = "factorial"', 'kind = "factorial"\nreplicates = 3')
RECORD = '[record]\nvariants = [1]\nworst = { metric = "tension_max", count = 1 }\n[metrics]\nkeep = ["tension_m*"]\n'
ANY = Limits(energy_residual=float("inf"), energy_change=float("inf"))


def test_rows_have_mean_error_and_n_of_their_copies(tmp_path):
    source = write_study(tmp_path, RECORD, points=2, shard=5, text=SEVERAL)
    outcome = run_study(source, tmp_path / "out")
    assert (outcome.shards, outcome.counts["ok"]) == ((3, 3), 12)
    table = parquet.read_table(outcome.table)
    copies = parquet.read_table(tmp_path / "out" / "replicates.parquet")
    assert copies["variant"].to_pylist() == [v for v in range(4) for _ in range(3)]
    assert copies["replicate"].to_pylist() == [0, 1, 2] * 4
    drives = [tiny_drive().with_values({"sprockets.s1.load.torque": t, "chain.links": n})
              for t in (0.0, 1.0) for n in (44, 45)]  # fmt: skip
    alone = simulate(drives, record=Record("none"), duration=0.0005, step=1e-5, limits=ANY, replicates=3)
    assert copies["tension_max"].to_pylist() == alone.metrics["tension_max"].to_pylist()
    assert table["tension_max"].to_pylist() == alone.summary["tension_max"].to_pylist()
    assert table["tension_max_se"].to_pylist() == alone.summary["tension_max_se"].to_pylist()
    assert table["n"].to_pylist() == [3] * 4
    results = read_results(table)
    assert results.factors == ("torque", "links")
    assert results.metrics == ("tension_min", "tension_max", "tension_mean")
    assert np.array_equal(results.standard_errors("tension_max"), np.array(table["tension_max_se"].to_pylist()))
    assert results.run_counts.tolist() == [3] * 4
    # recorded are the first copy of what is named, and the most extreme copy of the row that is worst in the mean
    worst = int(np.argmax(table["tension_max"].to_pylist()))
    archives = table["archive"].to_pylist()
    assert [name is not None for name in archives] == [v in (1, worst) for v in range(4)]
    if worst != 1:
        mine = [row["tension_max"] for row in copies.to_pylist() if row["variant"] == worst]
        held = read_archive(tmp_path / "out" / archives[worst])
        phases = [None, -0.5, 0.25]
        assert held[table["archive_variant"][worst].as_py()].drive.run.phase == phases[int(np.argmax(mine))]


def test_a_study_of_one_copy_has_no_column_of_its_own(tmp_path):
    once = STUDY.replace('kind = "factorial"', 'kind = "factorial"\nreplicates = 1')
    sources = [write_study(tmp_path / name, points=2, text=text) for name, text in (("a", STUDY), ("b", once))]
    tables = [parquet.read_table(run_study(source, source.parent / "out").table) for source in sources]
    assert tables[0].equals(tables[1])
    assert not (tmp_path / "b" / "out" / "replicates.parquet").exists()


def test_in_parts_and_by_shards_of_another_size_it_is_the_same(tmp_path):
    table = {}
    for shard in (1, 4, 100):
        source = write_study(tmp_path / str(shard), points=2, shard=shard, text=SEVERAL)
        out = tmp_path / str(shard) / "out"
        for part in (1, 0):
            run_study(source, out, part=(part, 2))
        assert study_status(out).left == 0
        run_study(source, out)
        table[shard] = parquet.read_table(out / "results.parquet").to_pylist()
    assert table[1] == table[4] == table[100]


def test_refusals(tmp_path, capsys):
    named = SEVERAL.replace('name = "torque"', 'name = "n"').format(points=2, shard=2)
    with pytest.raises(StudyError, match=r'factors\.n\.name = "n": is a column of studies'):
        loads_study(named)
    loads_study(named.replace("replicates = 3", ""))
    lines = loads_error(SEVERAL.replace("replicates = 3", "replicates = 0").format(points=2, shard=2))
    assert "design.replicates = 0: must be an integer from 1 to 10000" in lines
    lines = loads_error(SEVERAL.replace("replicates = 3", 'replicate_by = "phase"').format(points=2, shard=2))
    assert 'design.replicate_by = "phase": only together with replicates' in lines
    source = write_study(tmp_path, points=2, text=SEVERAL)
    words = ("study", "run", source, "-o", tmp_path / "out", "--quiet")
    assert run(capsys, *words)[0] == 0
    source.write_text(source.read_text().replace("replicates = 3", "replicates = 2"))
    assert "holds another study, which differs in design" in refused(capsys, *words)


def loads_error(text):
    with pytest.raises(StudyError) as caught:
        loads_study(text)
    return str(caught.value)
