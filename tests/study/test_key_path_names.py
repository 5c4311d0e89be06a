"""Entries of a study file's lists in messages: by their own metrics and names, and by their numbers from 1."""

import pytest

from warpchain.errors import StudyError
from warpchain.study.spec.study_file import loads_study

STUDY = '[study]\ndrive = "marine"\n[design]\nkind = "sobol"\ncount = 4\n'
FACTOR = '[[factors]]\nname = "torque"\npath = "sprockets.camshaft.load.torque"\nrange = [1.0, 2.0]\n'
LIMIT = '[[limits]]\nmetric = "tension_max"\nmax = 900.0\n'


@pytest.mark.parametrize(
    ("more", "lines"),
    [
        (LIMIT.replace("900.0", '"x"'), ['limit on "tension_max": max = "x": must be a finite number']),
        (
            "[[limits]]\nenergy_residual = 0.02\n" + LIMIT.replace("max =", "most ="),
            ['limit on "tension_max": most = 900.0: unknown key; allowed are metric, min, max',
             'limit on "tension_max": max: missing; must be a finite number; give max, min or both'],
        ),
        (LIMIT * 2, ['limit 2: metric = "tension_max": must be unique among limits']),
        ('[[limits]]\nmax = 900.0\n', ["limit 1: metric: missing; must be a text that is not empty"]),
        ('[[objectives]]\nmetric = "crank.slips"\nsense = "up"\n',
         ['objective "crank.slips": sense = "up": must be "min" or "max"']),
        ("[[objectives]]\nmetric = 3\n", ["objective 1: metric = 3: must be a text that is not empty"]),
        ("[[factors]]\nrange = [2.0, 1.0]\n", ["factor 2: name: missing; must be a word", "factor 2: range = [2.0"]),
        (FACTOR.replace("2.0", "0.5").replace("torque", "other", 1), ["factors.other.range = [1.0, 0.5]: must be two"]),
        ('[[constraints]]\nrequire = "tork > 1"\n', ['constraint 1: require = "tork > 1": tork is not a factor']),
        ("[record]\nchannels = ['tension', 'x']\nevery = 1\n", ['value 2 of record.channels = "x": must be one of']),
        ('[adjust]\nlinks = "odd"\npreload = 1.0\n', ['adjust.links = "odd": must be "even" or "any"']),
        ('[[measured]]\nsignal = "a.tension"\nfile = "a.csv"\nbands = [[2.0, 1.0]]\nerror = 1.0\n',
         ['measurement of "a.tension": value 1 of bands = [2.0, 1.0]: must be [low, high]']),
    ],
)  # fmt: skip
def test_an_entry_goes_by_its_own_name_or_its_number(more, lines):
    with pytest.raises(StudyError) as caught:
        loads_study(STUDY + FACTOR + more, "s.toml")
    found = str(caught.value).splitlines()
    for line in lines:
        assert any(one.startswith(f"s.toml: {line}") for one in found), found
