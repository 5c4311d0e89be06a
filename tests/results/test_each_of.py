"""Numbers that metrics take of drives: a stack's at once are those of each drive by itself, to the bit."""

import numpy as np
import pytest
from drives import example

from warpchain.model import Model
from warpchain.model.friction_coefficients import partner_friction_coefficients
from warpchain.model.stacks import stacks_of_drives
from warpchain.results import step_resolution
from warpchain.results.metric_formulas import number_of_each_drive
from warpchain.results.metrics import VariantEnds
from warpchain.results.ripple import slowest_ripple_periods
from warpchain.results.schedule import Schedule

FACTORS = np.random.default_rng(3).uniform(0.8, 1.2, (6, 4))
VALUES = {
    "marine": ("chain.stiffness", "chain.joint.friction", "chain.roller_mass", "sprockets.crankshaft.prescribed.speed"),
    "car": ("chain.stiffness", "chain.joint.friction", "contact.guide.friction", "chain.damping_ratio"),
    "engine": ("chain.stiffness", "chain.joint.friction", "sprockets.exhaust cam.inertia"),
    "v6": ("chains.primary.stiffness", "chains.left.stiffness"),
    "conveyor": ("chain.stiffness",),
}


def spread(name):
    """Drives that differ in some values, the chains of one with several each by itself."""
    base, paths = example(name), VALUES[name]
    values = [{path: base.get_value(path) * by for path, by in zip(paths, row, strict=False)} for row in FACTORS]
    drives = [base.with_values(each) for each in values]
    return [list(chains) for chains in zip(*(Model(drive).chains for drive in drives), strict=True)]


@pytest.mark.parametrize("name", VALUES)
def test_numbers_of_a_stack_are_those_of_each_drive(name):
    for drives in spread(name):
        stacks, partners = stacks_of_drives(drives), len(drives[0].sprockets) + len(drives[0].guides)
        assert len(stacks) == 1
        functions = [
            lambda drive: drive.chain.mass,
            lambda drive: drive.chain.links,
            step_resolution._tooth_bend_inertia,
        ]
        functions += [
            step_resolution._softest_link_stiffness,
            *[step_resolution._joint_friction_arm] * drives[0].chain.has_friction,
        ]
        functions += [
            lambda drive, k=k: partner_friction_coefficients(drive, k).larger_coefficient for k in range(partners)
        ]
        functions += [lambda drive, k=k: step_resolution._partner_ramp_time(drive, k) for k in range(partners)]
        for function in functions:
            np.testing.assert_array_equal(
                number_of_each_drive(drives, stacks, function), [function(drive) for drive in drives]
            )
        turns, seconds = 10.0 * FACTORS[:, :1] * np.ones(len(drives[0].sprockets)), FACTORS[:, 1]
        alone = [slowest_ripple_periods(*of) for of in zip(drives, turns, seconds, strict=True)]
        np.testing.assert_array_equal(
            number_of_each_drive(drives, stacks, slowest_ripple_periods, turns, seconds), alone
        )
        np.testing.assert_array_equal(number_of_each_drive(drives, None, slowest_ripple_periods, turns, seconds), alone)


def test_some_variants_have_the_stacks_of_all():
    drives = [*spread("marine")[0], *spread("engine")[0], *spread("marine")[0][::-1]]
    schedules = [Schedule(1e-6, 10, 5, 10, 0)] * len(drives)
    ended = VariantEnds(drives, schedules, *np.zeros((3, len(drives))), stacks=stacks_of_drives(drives))
    stiffness = np.array([drive.chain.stiffness for drive in drives])
    np.testing.assert_array_equal(ended.number_of_each(lambda drive: drive.chain.stiffness), stiffness)
    for some in (np.array([0, 3, 7, 8, 17]), np.arange(6, 12), np.array([5])):
        of = ended.select_variants(some)
        assert sorted(v for stack in of.stacks for v in stack.members.tolist()) == list(range(len(some)))
        np.testing.assert_array_equal(of.number_of_each(lambda drive: drive.chain.stiffness), stiffness[some])
