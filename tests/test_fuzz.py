"""Random changes of what users and disks hand to the readers: taken as it is meant, or refused; never anything else."""

import pytest
from loading import load_script

fuzz = load_script("fuzz")


@pytest.mark.parametrize("kind", fuzz.KINDS)
def test_a_few_hundred_cases_of_each_kind(kind, tmp_path, capsys):
    found = fuzz.fuzz([kind], 100 if kind == "commands" else 250, 20_000, tmp_path)[kind]
    assert found["broken"] == 0, capsys.readouterr().err
    assert found["accepted"] >= 5  # what is changed is right to begin with
    assert found["refused"] >= 50


def test_what_is_broken_is_told(capsys, tmp_path):
    def wrong(rng):
        raise KeyError(int(rng.integers(10)))

    assert fuzz.attempt(wrong, 7) == "broken"
    assert "broken: seed 7\n" in capsys.readouterr().err


def test_frames_of_another_variant_would_be_found(tmp_path):
    state = fuzz.Fuzz(tmp_path)
    state.run.trajectories[0], state.run.trajectories[1] = state.run.trajectories[1], state.run.trajectories[0]
    (tmp_path / "case.mcap").write_bytes(state.archives[0])
    with pytest.raises(fuzz.Broken, match="are other values"):
        state._compare(tmp_path / "case.mcap", whole=True)
