"""Expressions of study files: what values they give, and that any other kind of value is told in one line."""

import sys

import pytest

from warpchain.errors import StudyError
from warpchain.study.spec.expression import parse_expression

VALUES = {"x": "leapfrog", "y": 2.0, "n": 3, "on": True, "row": [1.0, 2.0], "none": None}


def deep(levels, call):
    """A call from so far down the stack."""
    return deep(levels - 1, call) if levels else call()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("y + n", 5.0),
        ("on + 1", 2),  # a switch counts
        ("x == 'leapfrog'", True),
        ("x == 1", False),  # a text is no number, and may be asked whether it is
        ("1 if x == 'rk4' else n", 3),
        ("x < 'rk4'", True),
        ("max(y, n) ** 2", 9),
        ("1 + 2 * n", 7),
        ("n ** 2 if n > 2 else -n", 9),
        ("0 < n <= 3 and not n == 2", True),
        ("max(n, 4) % 3 + n // 2", 2),
        ("round(pi * 100) / sqrt(4)", 157.0),
    ],
)
def test_values(text, value):
    found = parse_expression(text).evaluate(VALUES)
    assert found == value and type(found) is type(value)


NO_VALUE = {
    "'leapfrog' is not a number": ["x + 1", "-x", "x % n", "n ** x", "max(x, 1)"],
    "'x' is not a number": ["1 + 'x'", "'x' * 3"],
    "'leapfrog' and 3 have no order": ["x < n"],
    "3 and 'b' have no order": ["1 < n < 'b'"],
    r"\[1.0, 2.0\] is not a number": ["row + 1.0"],
    "None is not a number": ["y * none"],
    "not supported": ["row < 1"],
    "cannot be interpreted as an integer": ["round(y, y)"],
    "not iterable": ["max(n)"],
    "at least 1 argument": ["min()"],
    "domain": ["sqrt(-y)", "log(-1)", "(-2) ** 0.5"],
    "zero": ["n // 0", "n / 0"],
    "range": ["9 ** 9 ** 9 ** 9", "exp(1000 * n)"],
    "64 bits": ["10000 ** 16"],
    "infinity": ["round(1e308 * 10)"],
}


@pytest.mark.parametrize(("text", "told"), [(text, told) for told, texts in NO_VALUE.items() for text in texts])
def test_what_has_no_value_is_told(text, told):
    with pytest.raises(StudyError, match=told) as caught:
        parse_expression(text).evaluate(VALUES)
    assert "\n" not in str(caught.value)


NOT_ALLOWED = ["[1.0] + 2.0", "{1: 2}", "x.upper()", "row[0]", "lambda: 1", "f'{x}'", "b'x'", "1j", "None", "x.real"]
NO_ARITHMETIC = ["__import__('os')", "[1, 2]", "open('f')", "x = 1", "max", "x @ x", "(", "1" * 1001, "max(*x)", "x if"]
NO_ARITHMETIC += ["(" * 900 + "x" + ")" * 90, "x is x"]


@pytest.mark.parametrize("text", NOT_ALLOWED + NO_ARITHMETIC)
def test_what_is_no_arithmetic_is_refused(text):
    with pytest.raises(StudyError, match="allowed|unknown" if text in NOT_ALLOWED else None):
        parse_expression(text)


@pytest.mark.parametrize("sign", ["-", "not ", "n+", "abs("])
def test_however_deep_it_is_it_has_a_value_or_none(sign):
    """An expression may be asked for its value from anywhere, and Python's stack is no place to fall from."""
    told = 0
    for count in range(10, 990, 35):
        text = count * sign + "n" + count * ")" * (sign == "abs(")
        try:
            found = parse_expression(text)
        except StudyError:
            continue
        for levels in (0, sys.getrecursionlimit() - 350):
            try:
                deep(levels, lambda found=found: found.evaluate(VALUES))
            except StudyError as error:
                assert "deep" in str(error)
                told += 1
    assert told > 0 or sign in ("abs(", "not ")
