"""Structs go by reference in generated code where no function writes to one that it took, and only there."""

import re

import pytest
import warp as wp

from warpchain.kernels import modules


@wp.struct
class Inner:
    value: float


@wp.struct
class Given:
    value: float
    row: wp.vec2
    values: wp.array[float]
    inner: Inner
    inners: wp.array[Inner]


@wp.func
def passes_on(given: Given):
    return given.value + given.row[0] + given.inner.value


@wp.func
def reads(given: Given):
    copied = given
    copied.value = 1.0
    if given.value > 0.0:
        copied = given
    return copied.value + passes_on(given)


@wp.func
def writes_an_element(given: Given):
    given.values[0] = given.values[1]
    return given.value


@wp.func
def adds_to_a_field_of_an_element(given: Given):
    given.inners[0].value -= given.value
    return given.value


@wp.func
def writes_a_field(given: Given):
    given.value = 1.0
    return given.value


@wp.func
def writes_a_component(given: Given):
    given.row[0] = 1.0
    return given.row[0]


@wp.func
def adds_to_a_component(given: Given):
    given.row[0] += 1.0
    return given.row[0]


@wp.func
def writes_a_field_of_a_field(given: Given):
    given.inner.value = 1.0
    return given.inner.value


@wp.func
def takes_another(given: Given):
    for _ in range(int(given.value)):
        given = Given()
    return given.value


@wp.func
def passes_on_what_it_writes(given: Given):
    return writes_a_field(given)


@pytest.mark.parametrize("device", ["cpu", "cuda"])
@pytest.mark.parametrize(
    ("function", "by_reference"),
    [
        (reads, True),
        (writes_an_element, True),
        (adds_to_a_field_of_an_element, True),
        (writes_a_field, False),
        (writes_a_component, False),
        (adds_to_a_component, False),
        (writes_a_field_of_a_field, False),
        (takes_another, False),
        (passes_on_what_it_writes, False),
    ],
)
def test_structs_that_are_only_read_go_by_reference(function, by_reference, device):
    @wp.kernel(enable_backward=False, module=modules._Module(f"by_reference_{function.key}", b"this"))
    def calls(given: Given, out: wp.array[float]):
        out[0] = function(given)

    calls.module.get_module_hash(1)
    options = calls.module.resolved_options[1] | {"output_arch": 90}
    source, *_ = calls.module._run_codegen(options, device == "cpu")
    taken = re.findall(r"^static (?!.* adj_).*\n    Given_\w+ (& )?var_given[,)]", source, re.MULTILINE)
    assert taken
    assert all(map(bool, taken)) if by_reference else not any(taken)
