"""Select viewpoints and edges by an expression such as `degree > 4 and origin == "person"`.

Expressions are a small subset of Python. Python's parser reads them, and they are evaluated on arrays. No code is
executed.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from nvsim.errors import value_text
from nvsim.graph.edits.change import EditError
from nvsim.graph.quantities import EDGES, VIEWPOINTS, Kind, QuantityInputs, Values, quantity
from nvsim.graph.selection import NOTHING, GraphSelection
from nvsim.graph.types import NavGraph

_COMPARE: Mapping[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_ARITHMETIC: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_LONGEST = 2000  # maximum characters of an expression


def by_expression(
    graph: NavGraph, text: str, known: QuantityInputs | None = None, kind: Kind | None = None
) -> GraphSelection:
    """Return the viewpoints and edges for which an expression is true.

    The quantities in the expression determine the kind. Viewpoints are selected if all quantities exist for viewpoints,
    and edges if all exist for edges. `kind` restricts the result to one kind. Unknown values are NaN: every comparison
    with them is false, except `!=`.

    Expressions may use `and`, `or`, `not`, comparisons, `in (…)`, + - * /, numbers, strings, True, False, and abs().
    Raises EditError for any other expression and for unknown quantities.
    """
    tree = _parse(text)
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} - {"abs"}
    unknown = sorted(names - set(VIEWPOINTS) - set(EDGES))
    if unknown:
        known_names = ", ".join(sorted(set(VIEWPOINTS) | set(EDGES)))
        raise EditError(f"There is no quantity {unknown[0]!r}; choose one of {known_names}.")
    kinds: list[Kind] = [kind] if kind is not None else ["viewpoints", "edges"]
    fitting = [k for k in kinds if names <= set(VIEWPOINTS if k == "viewpoints" else EDGES)]
    if not fitting:
        raise EditError(f"No viewpoint and no edge has all of {', '.join(sorted(names))}; use separate expressions.")
    found = NOTHING
    for each in fitting:
        ids: tuple[Any, ...] = tuple(graph.viewpoints if each == "viewpoints" else graph.edges)
        values = {name: quantity(graph, name, known, each)[1] for name in names}
        chosen = frozenset(ids[i] for i in np.flatnonzero(_evaluate_condition(tree, values, len(ids), text)).tolist())
        found |= GraphSelection(viewpoints=chosen) if each == "viewpoints" else GraphSelection(edges=chosen)
    return found


def _parse(text: str) -> ast.expr:
    if len(text) > _LONGEST:
        raise EditError(f"The expression is longer than {_LONGEST} characters.")
    try:
        return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        where = f" at character {error.offset}" if isinstance(error, SyntaxError) and error.offset else ""
        raise EditError(
            f"{value_text(text)!r} is not a valid expression{where}; write, for example: degree > 4 and not reviewed."
        ) from error


def _evaluate_condition(tree: ast.expr, values: Mapping[str, Values], count: int, text: str) -> Values:
    with np.errstate(all="ignore"):
        try:
            found = np.asarray(_value(tree, values))
        except (TypeError, ZeroDivisionError, OverflowError, np.exceptions.DTypePromotionError) as error:
            raise EditError(f"{text!r} combines values of different types, such as text and numbers.") from error
        except RecursionError as error:
            raise EditError("The expression is nested too deeply.") from error
    if found.dtype != bool:
        raise EditError(f"{text!r} is not a condition; compare it with a value.")
    return np.broadcast_to(found, (count,))


def _value(node: ast.expr, values: Mapping[str, Values]) -> Any:
    match node:
        case ast.Name(id=name) if name in values:
            return values[name]
        case ast.Constant(value=value) if isinstance(value, bool | int | float | str):
            return value
        case ast.BoolOp(op=op, values=parts):
            join = np.logical_and if isinstance(op, ast.And) else np.logical_or
            return join.reduce(np.broadcast_arrays(*(_condition(part, values) for part in parts)))
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return np.logical_not(_condition(operand, values))
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_number(operand, values)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
            return _ARITHMETIC[type(op)](_number(left, values), _number(right, values))
        case ast.Call(func=ast.Name(id="abs"), args=[operand], keywords=[]):
            return np.abs(_number(operand, values))
        case ast.Compare(left=left, ops=ops, comparators=others):
            return _compare(left, ops, others, values)
    raise EditError(f"{ast.unparse(node)[:40]!r} is not allowed in an expression.")


def _compare(left: ast.expr, ops: list[ast.cmpop], others: list[ast.expr], values: Mapping[str, Values]) -> Any:
    found: Any = True
    for op, other in zip(ops, others, strict=True):
        if isinstance(op, ast.In | ast.NotIn):
            if not isinstance(other, ast.Tuple | ast.List):
                raise EditError("Write a list such as (1, 2) after `in`.")
            any_of: Any = False
            for item in other.elts:
                any_of = np.logical_or(any_of, _pair(operator.eq, left, item, values))
            held = any_of if isinstance(op, ast.In) else np.logical_not(any_of)
        elif type(op) in _COMPARE:
            held = _pair(_COMPARE[type(op)], left, other, values)
        else:
            raise EditError("Compare with == != < <= > >= or in.")
        found, left = np.logical_and(found, held), other
    return found


def _pair(compare: Callable[[Any, Any], Any], left: ast.expr, right: ast.expr, values: Mapping[str, Values]) -> Any:
    a, b = np.asarray(_value(left, values)), np.asarray(_value(right, values))
    if (a.dtype.kind == "U") != (b.dtype.kind == "U"):
        raise TypeError
    return compare(a, b)


def _condition(node: ast.expr, values: Mapping[str, Values]) -> Values:
    found = np.asarray(_value(node, values))
    if found.dtype != bool:
        raise EditError(f"{ast.unparse(node)[:40]!r} is not a condition; compare it with a value.")
    return found


def _number(node: ast.expr, values: Mapping[str, Values]) -> Values:
    found = np.asarray(_value(node, values))
    if found.dtype.kind not in "bif":
        raise TypeError
    return found.astype(np.float64)
