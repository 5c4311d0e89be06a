"""Arithmetic expressions in study files: numbers, names of factors, operators and a few functions."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from warpchain.errors import StudyError

FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": abs,
    "ceil": math.ceil,
    "cos": math.cos,
    "exp": math.exp,
    "floor": math.floor,
    "log": math.log,
    "max": max,
    "min": min,
    "round": round,
    "sin": math.sin,
    "sqrt": math.sqrt,
    "tan": math.tan,
}
CONSTANTS: Mapping[str, Any] = {"pi": math.pi, "true": True, "false": False}
RESERVED_NAMES = frozenset(FUNCTIONS) | frozenset(CONSTANTS)

_MOST_CHARACTERS = 1000
_BINARY_OPERATORS: Mapping[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
}
_UNARY_OPERATORS: Mapping[type, Callable[[Any], Any]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
}
_COMPARISONS: Mapping[type, Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}


class _ExpressionError(Exception):
    """Mistake in an expression or its value."""


@dataclass(frozen=True)
class Expression:
    """Arithmetic expression, parsed."""

    text: str
    names: tuple[str, ...]  # that are neither functions nor constants, in order
    _tree: ast.expr = field(repr=False, compare=False)

    def evaluate(self, values: Mapping[str, Any]) -> Any:
        """Value of the expression for values of its `names`.

        Raises:
            StudyError: no value, such as a division by zero.
        """
        try:
            found = _tree_value(self._tree, values)
            if isinstance(found, int) and abs(found) >= 2**63:
                raise _ExpressionError("a whole number beyond 64 bits")
            return found
        except RecursionError:
            raise StudyError("nested too deeply") from None
        except (_ExpressionError, ArithmeticError, ValueError, TypeError) as error:
            raise StudyError(str(error).splitlines()[0] if str(error) else "no value") from None


@cache
def parse_expression(text: str) -> Expression:
    """Expression parsed from text.

    Raises:
        StudyError: what is not arithmetic, and what is allowed.
    """
    if len(text) > _MOST_CHARACTERS:
        raise StudyError(f"longer than {_MOST_CHARACTERS} characters")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        names = dict.fromkeys(_names_in_tree(tree))
    except SyntaxError as error:
        raise StudyError(f"not an expression ({error.msg})") from None
    except (ValueError, RecursionError, MemoryError):
        raise StudyError("not an expression") from None
    except _ExpressionError as wrong:
        raise StudyError(str(wrong)) from None
    return Expression(text, tuple(names), tree)


def _names_in_tree(node: ast.AST) -> list[str]:
    """Names in an expression's tree; raises if not arithmetic."""
    if isinstance(node, ast.Name):
        if node.id in FUNCTIONS:
            raise _ExpressionError(f"{node.id} is a function: write {node.id}(...)")
        return [] if node.id in CONSTANTS else [node.id]
    if isinstance(node, ast.Constant):
        if not isinstance(node.value, (bool, int, float, str)):
            raise _ExpressionError(f"{node.value!r} is not allowed")
        return []
    parts: list[ast.expr]
    if isinstance(node, ast.BinOp) and (type(node.op) in _BINARY_OPERATORS or isinstance(node.op, ast.Pow)):
        parts = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY_OPERATORS:
        parts = [node.operand]
    elif isinstance(node, ast.BoolOp):
        parts = node.values
    elif isinstance(node, ast.Compare) and all(type(op) in _COMPARISONS for op in node.ops):
        parts = [node.left, *node.comparators]
    elif isinstance(node, ast.IfExp):
        parts = [node.test, node.body, node.orelse]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        if node.func.id not in FUNCTIONS:
            raise _ExpressionError(f"{node.func.id}() is unknown; functions are {', '.join(FUNCTIONS)}")
        parts = node.args
    else:
        raise _ExpressionError("only numbers, names of factors, + - * / // % **, comparisons, and, or, not, "
                               "if-else and "
                     f"{', '.join(FUNCTIONS)} are allowed")  # fmt: skip
    return [name for part in parts for name in _names_in_tree(part)]


def _tree_value(node: ast.expr, values: Mapping[str, Any]) -> Any:
    """Value of an expression's tree, already checked."""
    match node:
        case ast.Constant():
            return node.value
        case ast.Name():
            return CONSTANTS[node.id] if node.id in CONSTANTS else values[node.id]
        case ast.BinOp():
            left, right = (
                _checked_number(_tree_value(node.left, values)),
                _checked_number(_tree_value(node.right, values)),
            )
            return (
                _bounded_power(left, right)
                if isinstance(node.op, ast.Pow)
                else _BINARY_OPERATORS[type(node.op)](left, right)
            )
        case ast.UnaryOp():
            operand = _tree_value(node.operand, values)
            return _UNARY_OPERATORS[type(node.op)](
                operand if isinstance(node.op, ast.Not) else _checked_number(operand)
            )
        case ast.BoolOp():
            found = (bool(_tree_value(part, values)) for part in node.values)
            return all(found) if isinstance(node.op, ast.And) else any(found)
        case ast.Compare():
            left = _tree_value(node.left, values)
            for op, part in zip(node.ops, node.comparators, strict=True):
                right = _tree_value(part, values)
                if not isinstance(op, ast.Eq | ast.NotEq) and isinstance(left, str) != isinstance(right, str):
                    raise _ExpressionError(f"{left!r} and {right!r} have no order")
                if not _COMPARISONS[type(op)](left, right):
                    return False
                left = right
            return True
        case ast.IfExp():
            return _tree_value(node.body if _tree_value(node.test, values) else node.orelse, values)
        case ast.Call(func=ast.Name(id=name)):
            return FUNCTIONS[name](*(_checked_number(_tree_value(part, values)) for part in node.args))
    raise _ExpressionError("not an expression")


def _checked_number(value: Any) -> Any:
    """Value of an expression; raises if no number or switch."""
    if not isinstance(value, (bool, int, float)):
        raise _ExpressionError(f"{value!r} is not a number")
    return value


def _bounded_power(base: Any, exponent: Any) -> Any:
    """Power in an expression; raises for large whole ones."""
    if isinstance(base, int) and isinstance(exponent, int) and 0 <= exponent <= 16 and abs(base) <= 10**4:
        return base**exponent
    return math.pow(base, exponent)
