"""Random changes of what users and disks hand to the readers: taken as it is meant, or refused; never anything else."""

import pytest
from drives import but
from loading import load_script

fuzz = load_script("fuzz")


@pytest.mark.parametrize("kind", but(fuzz.KINDS, ("archives", "folders", "tables")))
def test_a_few_hundred_cases_of_each_kind(kind, tmp_path):
    found = fuzz.fuzz(getattr(fuzz.Fuzz(tmp_path), kind), 500, 20_000)
    assert found["accepted"] >= 5  # what is changed is right to begin with
    assert found["refused"] >= 50


def test_what_is_broken_is_raised():
    def wrong(draw):
        if draw(fuzz.number_below(10)) > 5:
            raise KeyError("wrong")

    with pytest.raises(KeyError, match="wrong"):
        fuzz.fuzz(wrong, 100, 7)


def test_frames_of_another_variant_would_be_found(tmp_path):
    state = fuzz.Fuzz(tmp_path)
    state.run.trajectories[0], state.run.trajectories[1] = state.run.trajectories[1], state.run.trajectories[0]
    (tmp_path / "case.mcap").write_bytes(state.files[0])
    with pytest.raises(AssertionError, match="are other values"):
        state.compare(tmp_path / "case.mcap", whole=True)
