"""Parsed definitions of functions of the subset: their calls, their results and the names in them."""

from __future__ import annotations

import ast
import inspect
import linecache
from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from functools import cache
from typing import Any, NamedTuple

from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Group, Kind

SCALARS: Mapping[str, Kind] = {"int": INTEGER, "float": NUMBER, "bool": FLAG}
"""Kinds of numbers by their annotations."""


@cache
def definition_of(function: Any) -> ast.FunctionDef:
    """Return the parsed definition of a function, which nobody changes.

    Raises
    ------
    TypeError
        If the function is not where it was when its module was imported.
    """
    defined = inspect.unwrap(function)
    code = defined.__code__
    # not by inspect.getsource, which first looks at every imported module, and then for the end of the function
    text = "".join(linecache.getlines(code.co_filename, defined.__globals__))
    found = _definitions(text).get(code.co_firstlineno)
    if found is None or found.name != code.co_name:
        raise TypeError(f"{code.co_filename} has no {code.co_name} in line {code.co_firstlineno}: start Python anew")
    return found


@cache
def _definitions(text: str) -> Mapping[int, ast.FunctionDef]:
    """Return the parsed functions of a module by the number of their first line."""
    found = _functions(ast.parse(text).body)
    return {min([node.lineno, *(each.lineno for each in node.decorator_list)]): node for node in found}


def _functions(statements: Sequence[ast.stmt]) -> Iterator[ast.FunctionDef]:
    for statement in statements:
        if isinstance(statement, ast.FunctionDef):
            yield statement
        yield from _functions(getattr(statement, "body", ()))


@cache
def called_in(node: ast.AST) -> tuple[ast.expr, ...]:
    """Return what a piece of a parsed definition calls."""
    return tuple(part.func for part in ast.walk(node) if isinstance(part, ast.Call))


@cache
def scalars_of(tree: ast.FunctionDef) -> tuple[Kind | None, ...]:
    """Return the annotated kinds of the arguments of a function that are numbers, None for the others."""
    annotations = (argument.annotation for argument in tree.args.args)
    return tuple(SCALARS.get(kind.id) if isinstance(kind, ast.Name) else None for kind in annotations)


class Read(NamedTuple):
    """Names in an expression, and whether it reads memory."""

    names: AbstractSet[str]
    memory: bool


@cache
def read_in(node: ast.expr) -> Read:
    """Return what an expression of a parsed definition reads."""
    parts = list(ast.walk(node))
    names = {part.id for part in parts if isinstance(part, ast.Name)}
    return Read(names, any(isinstance(part, ast.Subscript | ast.Attribute) for part in parts))


def result_of(annotation: ast.expr | None) -> Kind:
    """Return the annotated kind of the result of a function."""
    match annotation:
        case ast.Name(id=name) if name in SCALARS:
            return SCALARS[name]
        case ast.Constant(value=None):
            return Group(())
        case ast.Subscript(value=ast.Name(id="tuple"), slice=ast.Tuple(elts=elements)):
            return Group(tuple(result_of(element) for element in elements))
    raise TypeError("a function returns nothing, a number, or a tuple of numbers, and is annotated so")


class Names(NamedTuple):
    """Uses of the names of a function.

    Attributes
    ----------
    stored : mapping of str to int
        Number of assignments to each name.
    targets : set of str
        Targets of loops over tuples.
    counters : set of str
        Names that only count the rounds of loops.
    """

    stored: Mapping[str, int]
    targets: AbstractSet[str]
    counters: AbstractSet[str]


@cache
def names_of(tree: ast.FunctionDef) -> Names:
    """Return the uses of the names of a function."""
    stored: dict[str, int] = {}
    loads: dict[str, int] = {}
    inside: dict[str, int] = {}
    loops: dict[str, int] = {}
    targets: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            counts = stored if isinstance(node.ctx, ast.Store) else loads
            counts[node.id] = counts.get(node.id, 0) + 1
        elif isinstance(node, ast.For) and isinstance(node.iter, ast.Tuple):
            targets |= {n.id for n in ast.walk(node.target) if isinstance(n, ast.Name)}
        elif isinstance(node, ast.For) and isinstance(node.target, ast.Name):
            name = node.target.id
            read = [n for part in node.body for n in ast.walk(part) if isinstance(n, ast.Name) and n.id == name]
            loops[name] = loops.get(name, 0) + 1
            inside[name] = inside.get(name, 0) + sum(isinstance(n.ctx, ast.Load) for n in read)
    counters = {name for name, count in loops.items() if count == stored[name] and inside[name] == loads.get(name, 0)}
    return Names(stored, targets, counters)


def leaves_of(body: list[ast.stmt]) -> set[type[ast.stmt]]:
    """Return by which statements a body leaves the loop around it."""
    found: set[type[ast.stmt]] = set()
    for node in body:
        if isinstance(node, ast.Break | ast.Continue):
            found.add(type(node))
        elif isinstance(node, ast.If):
            found |= leaves_of(node.body) | leaves_of(node.orelse)
    return found
