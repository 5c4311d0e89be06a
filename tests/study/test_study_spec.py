"""The study file: what it may say, each of its rules once, and that it reads back equal."""

import re
from pathlib import Path

import pytest
from drives import example

from warpchain.drive.schema import Part
from warpchain.errors import DriveError, StudyError
from warpchain.study.spec import check_base_drive, dumps_study, load_study, loads_study
from warpchain.study.spec import factor as spec_factor
from warpchain.study.spec import study_file as spec
from warpchain.study.spec import study_tables as spec_tables

WHOLE = """
study = { drive = "marine", name = "all keys" }
design = { kind = "sobol", count = 8, seed = 5 }
constraints = [{ require = "torque < 10e3 or seats > 130" }]
adjust = { sprocket = "tightener", direction = [1.0, 0.0], travel = 0.05, links = "even", preload = "0.2 * torque" }
run = { duration = 0.01, step = 1e-5, precision = "float32", device = "cpu", window = [0.0, 0.01], shard = 100 }
metrics = { keep = ["tension_*", "camshaft.*"] }
fatigue = { exponent = 5.0, range = 2e4, cycles = 2e6 }

factors = [
  { name = "torque", path = "sprockets.camshaft.load.torque", range = [6e3, 12e3], unit = "N m" },
  { name = "stiffness", paths = ["chain.stiffness", "contact.sprocket.width"], distribution = "truncated-normal", \
    mean = 1.5e9, std = 1e8, range = [1e9, 2e9], group = "material" },
  { name = "seats", path = "contact.sprocket.seat_angle", levels = [130, 135.5], group = "material" },
  { name = "wrap", path = "sprockets.tightener.wrap", choice = ["cw", "ccw"] },
  { name = "viscous", path = "sprockets.camshaft.load.viscous", expression = "torque / 100", integer = true },
]
[record]
variants = [0, 3]
every = 4
worst = { metric = "tension_max", count = 2, side = "smallest" }
rate = 1000.0
channels = ["position", "tension"]
"""
FACTOR = '[[factors]]\nname = "torque"\npath = "sprockets.camshaft.load.torque"\n'
DESIGN = '[design]\nkind = "sobol"\ncount = 4\n'
HEAD = '[study]\ndrive = "marine"\n'
RANGE = FACTOR + "range = [1.0, 2.0]\n"


def errors_of(text):
    with pytest.raises(StudyError) as caught:
        loads_study(text, "study.toml")
    return str(caught.value).splitlines()


def test_a_whole_file_reads_back_equal():
    study = loads_study(WHOLE)
    assert loads_study(dumps_study(study)) == study
    kinds = "uniform truncated-normal levels choice expression"
    assert [factor.value_source for factor in study.factors] == kinds.split()
    assert study.factors[0].listed_values is None and study.factors[2].listed_values == (130, 135.5)
    with pytest.raises(ValueError):
        study.run.duration = 1.0


def factor(text):
    return HEAD + DESIGN + FACTOR + text


def kind(text, more=RANGE):
    return HEAD + "[design]\n" + text + "\n" + more


COUNT = "must be an integer of at least 1"
WITH = HEAD + DESIGN + RANGE
ADJUST = WITH + "[adjust]\n"
EXPECTED = [
    # tables and keys
    (DESIGN + RANGE, "study: missing; must be a table"),
    (HEAD + RANGE, "design: missing; must be a table"),
    (HEAD + DESIGN, "factors: missing; must be a list of at least 1 factor"),
    ("factors = []\n" + HEAD + DESIGN, "factors = []: must be a list of at least 1 factor"),
    (WITH + "[study2]\n", "study2 = {}: unknown key; did you mean study?"),
    (HEAD + "drives = 1\n" + DESIGN + RANGE, "study.drives = 1: unknown key; did you mean drive?"),
    ("[study]\ndrive = 3\n" + DESIGN + RANGE, "study.drive = 3: must be a text that is not empty"),
    (WITH + '[[objectives]]\nmetric = ["a"]\n', 'objective 1: metric = ["a"]: must be a text that is not empty'),
    (WITH + "[[limits]]\nmetric = [1]\nmax = 1\n", "limit 1: metric = [1]: must be a text that is not empty"),
    # factors
    (factor("rang = [1, 2]"), "factors.torque.rang = [1, 2]: unknown key; did you mean range?"),
    (factor(""), "factors.torque.range: missing; give range, a distribution, levels, choice or expression"),
    (factor("range = [2, 1]"), "factors.torque.range = [2, 1]: must be two finite numbers [low, high], low below high"),
    (factor("range = [1, inf]"), "factors.torque.range = [1, inf]: must be two finite"),
    (factor('range = [0, 1]\ndistribution = "log-uniform"'), "factors.torque.range = [0, 1]: must be two positive"),
    (factor('range = [0, 1]\ndistribution = "beta"'), 'factors.torque.distribution = "beta": must be "uniform", '),
    (factor('distribution = "normal"\nmean = 1'), "factors.torque.std: missing; must be a positive number; needed"),
    (factor('distribution = "normal"\nmean = 1\nstd = 0'), "factors.torque.std = 0: must be a positive number"),
    (factor('distribution = "normal"\nmean = 1\nstd = 1\nrange = [0, 1]'), "factors.torque.range = [0, 1]: not with"),
    (factor("range = [0, 1]\nmean = 1"), 'factors.torque.mean = 1.0: not with distribution "uniform"'),
    (factor("mean = 1"), 'factors.torque.mean = 1.0: needs distribution "normal" or "truncated-normal"'),
    (factor("levels = [1]"), "factors.torque.levels = [1]: must be a list of at least 2 different finite numbers"),
    (factor("levels = [1, 1]"), "factors.torque.levels = [1, 1]: must be a list of at least 2 different"),
    (factor('choice = [1, "a"]'), 'factors.torque.choice = [1, "a"]: must be a list of at least 2 different values'),
    (factor("levels = [1, 2]\nrange = [1, 2]"), "factors.torque.range = [1, 2]: not together with levels"),
    (factor("levels = [1, 2]\ninteger = true"), "factors.torque.integer = true: not together with levels"),
    (factor("range = [1, 2]\npoints = 3"), "factors.torque.points = 3: only in a factorial design"),
    (factor('range = [1, 2]\npaths = ["chain.links"]'), 'factors.torque.paths = ["chain.links"]: not together with'),
    (factor('range = [1, 2]\ngroup = "a"'), 'factors.torque.group = "a": has no other factor'),
    (RANGE.replace("torque", "max", 1) + HEAD + DESIGN, 'factors.max.name = "max": must be a word'),
    (RANGE.replace("torque", "status", 1) + HEAD + DESIGN, 'factors.status.name = "status": must be a word'),
    (WITH + RANGE, 'factor 2: name = "torque": must be unique among factors'),
    (WITH + RANGE.replace("torque", "t", 1), 'is set by factor "torque" already'),
    (HEAD + DESIGN + '[[factors]]\nname = "a"\nrange = [1, 2]', "factors.a.path: missing; must be a key path into"),
    # expressions
    (factor('expression = "2 *"'), 'factors.torque.expression = "2 *": not an expression'),
    (factor('expression = "2 * speed"'), "speed is not a factor; factors are torque"),
    (factor('expression = "torque + 1"'), 'factors.torque.expression = "torque + 1": needs itself'),
    (factor('expression = "open(1)"'), "open() is unknown; functions are"),
    (WITH + '[[constraints]]\nrequire = "tork > 1"', 'constraint 1: require = "tork > 1": tork is'),
    (WITH + "[[constraints]]\nrequire = 1", "constraint 1: require = 1: must be a text"),
    # designs
    (kind('kind = "random"'), 'design.kind = "random": must be "factorial", "latin-hypercube", "sobol", "halton", '),
    (kind('kind = "sobol"'), f'design.count: missing; {COUNT}, and at most 100000000; needed with kind "sobol"'),
    (kind('kind = "sobol"\ncount = 0'), f"design.count = 0: {COUNT}"),
    (kind('kind = "sobol"\ncount = 4\nseed = -1'), "design.seed = -1: must be an integer of at least 0"),
    (kind('kind = "factorial"\ncount = 4'), 'design.count = 4: not with kind "factorial"'),
    (kind('kind = "factorial"'), "factors.torque.points: missing; must be an integer from 2 to 100000; needed in a"),
    (kind('kind = "table"'), "design.file: missing; must be a text that is not empty; needed with kind"),
    (kind('kind = "table"\nfile = "a.csv"', FACTOR + "range = [1, 2]\npoints = 3"), "factors.torque.points = 3: only"),
    (kind('kind = "central-composite"\naxial = "star"'), 'design.axial = "star": must be "face", '),
    (kind('kind = "central-composite"', FACTOR + "levels = [1, 2]"), "factors.torque.levels = [1, 2]: a central"),
    (kind('kind = "plackett-burman"', FACTOR + "levels = [1, 2, 3]"), "factors.torque.levels = [1, 2, 3]: a Plackett"),
    (
        kind('kind = "factorial"', FACTOR + 'levels = [1, 2]\ngroup = "g"\n[[factors]]\nname = "b"\n'
             'path = "chain.links"\nlevels = [1, 2, 3]\ngroup = "g"'),
        'factors.b.group = "g": factors of a group must have equally many levels, choices or points',
    ),
    # adjust
    (ADJUST + "preload = 1.0", "adjust.sprocket: missing; give the sprocket that moves, or links, or both"),
    (ADJUST + 'sprocket = "a"\npreload = 1', "adjust.direction: missing; must be two finite numbers"),
    (ADJUST + 'links = "even"\ndirection = [1, 0]\npreload = 1', "adjust.direction = [1.0, 0.0]: only together with"),
    (ADJUST + 'links = "odd"\npreload = 1', 'adjust.links = "odd": must be "even" or "any"'),
    (ADJUST + 'links = "any"', "adjust.preload: missing; must be a finite number, or an expression of factors, or"),
    (ADJUST + 'links = "any"\npreload = 1\nstrain = 1', "adjust.strain = 1.0: not together with preload"),
    (ADJUST + 'links = "any"\npreload = -1', "adjust.preload = -1.0: must be at least 0 N"),
    (ADJUST + 'links = "any"\nstrain = "x"', 'adjust.strain = "x": x is not a factor; factors are torque'),
    # limits, run, metrics, record
    (WITH + "[limits]\nenergy_residual = -1", "limits.energy_residual = -1: must be a number of at least 0, or inf"),
    (WITH + "[limits]\nslip = 1", "limits.slip = 1: unknown key; did you mean slips?"),
    (WITH + "[run]\nduration = 0", "run.duration = 0: must be a positive number"),
    (WITH + '[run]\nprecision = "half"', 'run.precision = "half": must be "float64" or "float32"'),
    (WITH + "[run]\nwindow = [2, 1]", "run.window = [2.0, 1.0]: must be two times [start, end]"),
    (WITH + "[run]\nshard = 0", "run.shard = 0: must be an integer of at least 1"),
    (WITH + "[metrics]\nkeep = []", "metrics.keep = []: must be a list of texts"),
    (WITH + "[record]\nevery = 0", "record.every = 0: must be an integer of at least 1"),
    (WITH + "[record]\nvariants = [-1]", "record.variants = [-1]: must be a list of integers"),
    (WITH + '[record]\nchannels = ["x"]', 'value 1 of record.channels = "x": must be one of position'),
    (WITH + "[record.worst]\ncount = 1", "record.worst.metric: missing; must be a text"),
    (WITH + '[record.worst]\nmetric = "a"\ncount = 1\nside = "top"', 'record.worst.side = "top": '),
    (WITH + "[fatigue]\nexponent = 5\nrange = 1e4", "fatigue: needs record.variants, record.every "),
    (WITH + "[fatigue]\nexponent = 0\nrange = 1e4", "fatigue.exponent = 0: must be a positive number"),
    (WITH + '[record]\nevery = 1\nchannels = ["position"]\n[fatigue]\nexponent = 5\nrange = 1e4',
     'record.channels = ["position"]: must hold "tension", which fatigue counts'),
]  # fmt: skip


@pytest.mark.parametrize(("text", "line"), EXPECTED, ids=[str(i) for i in range(len(EXPECTED))])
def test_each_rule_names_file_key_and_value(text, line):
    found = errors_of(text)
    assert all(error.startswith("study.toml: ") for error in found)
    assert any(line in error for error in found)


def test_all_errors_are_told_at_once():
    text = factor("levels = [1]\n[run]\nduration = 0\n").replace("count = 4", "count = 0")
    assert len(errors_of(text)) == 3


def test_what_is_no_toml_is_told_with_its_place(tmp_path):
    assert errors_of("[study") == [errors_of("[study")[0]] and "not TOML" in errors_of("[study")[0]
    (tmp_path / "a.toml").write_bytes(b"\xff")
    for name, text in (("a.toml", "byte 0 is not UTF-8"), ("b.toml", "cannot be read: no such file or directory")):
        with pytest.raises(StudyError, match=f"{name}.*{text}"):
            load_study(tmp_path / name)


@pytest.mark.parametrize("document", ["studies.md", "optimization.md"])
def test_document_names_every_key(document):
    text = (Path(__file__).parents[2] / "docs" / document).read_text()
    searched = (spec_tables.Objective, spec_tables.Bound, spec_tables.Search)
    for part in (spec.Subject, spec.Study, spec_factor.Factor, *vars(spec_tables).values()):
        if isinstance(part, type) and issubclass(part, Part) and part is not Part:
            for key in part.model_fields if (part in searched) == (document == "optimization.md") else ():
                assert re.search(rf"`[^`]*\b{key}\b[^`]*`|^\[+{key}\b", text, re.MULTILINE), (part, key)


def test_paths_are_held_against_the_drive():
    drive = example("marine")
    check_base_drive(loads_study(WHOLE), drive, "study.toml")
    spoiled = WHOLE.replace("camshaft.load.torque", "camshaft.lod.torque").replace('"contact.sprocket.width"', '"gear"')
    with pytest.raises(StudyError) as caught:
        check_base_drive(loads_study(spoiled.replace('= "tightener"', '= "idler"')), drive, "study.toml")
    lines = str(caught.value).splitlines()
    assert len(lines) == 3
    path, nearest = 'factors.torque.path = "sprockets.camshaft.lod.torque"', "sprockets.camshaft.load.torque"
    names = "crankshaft, tightener, camshaft"
    assert lines[0] == f"study.toml: {path}: unknown path; did you mean {nearest}?"
    assert lines[1].startswith('study.toml: factors.stiffness.paths.1 = "gear": unknown path; ')
    assert lines[2] == f'study.toml: adjust.sprocket = "idler": must be a sprocket of the drive: {names}'


def test_one_adjustment_is_a_table_as_it_was():
    """Folders of studies that adjust one chain are gone on with, whose `study.toml` has a table."""
    study, text = loads_study(WHOLE), ADJUST + 'links = "any"\npreload = 1.0\n'
    assert "[adjust]\n" in dumps_study(study) and "[[adjust]]" not in dumps_study(study)
    assert loads_study(text.replace("[adjust]", "[[adjust]]")) == loads_study(text)
    assert "[[adjust]]\n" in dumps_study(study.model_copy(update={"adjust": study.adjust * 2}))
    held = {name: getattr(study, name) for name in spec.Study.model_fields}
    assert all(spec.Study(**{**held, "adjust": one}) == study for one in (study.adjust, study.adjust[0]))
    assert spec.Study(**{**held, "adjust": None}).adjust == ()


def test_an_empty_list_that_is_not_the_default_is_written():
    """A study that records no channels is not one that records all."""
    without = WHOLE.replace("fatigue", "# fatigue").partition("[record]")[0]
    study = loads_study(without + "[record]\nevery = 2\nchannels = []\n")
    assert study.record.channels == ()
    assert "channels = []" in dumps_study(study)
    assert loads_study(dumps_study(study)) == study


def test_a_study_made_in_python_has_no_more_factors_than_a_file():
    factor = {"path": "chain.roller_mass", "range": [1.0, 2.0]}
    factors = [factor | {"name": f"f{k}"} for k in range(spec.MOST_FACTORS + 1)]
    with pytest.raises(DriveError, match=r"^factors: 1001 of them; must be at most 1000$"):
        spec.Study(study={"drive": "marine"}, design={"kind": "sobol", "count": 4}, factors=factors)
