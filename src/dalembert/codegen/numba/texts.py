"""Text of the functions of a numba module, printed through ``codegen_templates/numba``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ...ir.calls import SYMBOL, function_of
from ...ir.kernel import Kernel, describe_counts
from ...ir.program import Program
from ...ir.tables import numbers_of, table_of
from ...methods.tableau import Tableau
from ...transforms.runge_kutta import AttemptPieces, attempt_kernel, attempt_pieces, start_kernel, start_pieces
from ...transforms.taylor.recurrences import Recurrences
from ...transforms.taylor.step import step_kernel
from ..llvm.target import target
from ..printers import NUMBA
from ..rendering import banner_lines, program_variables, render
from .taylor_loops import taylor_loop

# Tables in numba modules: numbers of their pieces, and the search for a piece.

_SEARCH, _ARRAY = re.compile(r"\b_piece_(\d+)\("), re.compile(r"\b_table_(\d+)_(\d+)\(")
_CALLED = re.compile(r"\b_call_(\d+)\(")


def table_definitions(text: str) -> str:
    """Return the definitions of what printed functions use of tables, and call; nothing where they use none."""
    called = [_declaration(key) for key in dict.fromkeys(_CALLED.findall(text))]
    return "\n\n".join(part for part in ("\n".join(called), _piece_definitions(text)) if part)


def _declaration(key: str) -> str:
    """Return the definition of a compiled function of a user, which machine code calls by its symbol."""
    given = ", ".join(["NUMBER"] * function_of(key).count)
    return f'_call_{key} = numba.types.ExternalFunction("{SYMBOL}{key}", NUMBER({given}))'


def _piece_definitions(text: str) -> str:
    searched, read = dict.fromkeys(_SEARCH.findall(text)), dict.fromkeys(_ARRAY.findall(text))
    if not searched and not read:
        return ""
    rows = [(key, "edges", table_of(int(key)).edges) for key in searched]
    rows += [(key, row, numbers_of(int(key)).row(int(row))) for key, row in read]
    variables: dict[str, Any] = {
        "arrays": [{"name": f"_table_{key}_{row}", "numbers": _listed(values)} for key, row, values in rows],
        "searches": [{"key": key, "count": len(table_of(int(key)).edges)} for key in searched],
    }
    return render("numba/tables.py.j2", variables)


def _listed(values: Any) -> str:
    """Return numbers as an expression of Python."""
    printed = (repr(float(value)) for value in values)
    return "[" + ", ".join("math.nan" if number == "nan" else number for number in printed) + "]"


_LARGEST_STRAIGHT = 3000
"""Lines up to which a Taylor step is written out. numba takes 1.3 ms a line of straight arithmetic (2.2 ms on a busy
machine), up to 6,000 lines in proportion to their number. Loops over the orders take a second, and 3 ms a line, of
which there are two for each value: they are compiled as quickly at 1,800 lines written out and more quickly beyond
(17 s where 20,000 lines would take half a minute, 30 s at 33,000), and run at two thirds of the speed (ready scenes and
chains of pendulums at order 14, processor time)."""

_LARGEST_INLINED = 1000
"""Operations of all evaluations of the right-hand side together, above which an attempt calls it."""

_ENTRY = ("t", "y", "c", "s", "out")


def joined(*texts: str) -> str:
    """Return the text of functions in one module."""
    return "\n\n".join(text.rstrip("\n") + "\n" for text in texts)


def prelude(program: Program | None) -> str:
    """Return the beginning of a module: banner, imports, and the functions that kernels use."""
    banner = [] if program is None else banner_lines(program)
    return render("numba/prelude.py.j2", {"banner": banner, "fused": target().fused})


def module(program: Program, further: Sequence[str] = ()) -> str:
    """Return the module of all kernels of a program, and of further functions."""
    functions = joined(*(program_kernel(program, kernel.name) for kernel in program), *further)
    tables = table_definitions(functions)
    return joined(prelude(program), *([tables] if tables else []), functions)


def program_kernel(program: Program, name: str) -> str:
    """Return a kernel of a program, as people call it, and ``NAME_entry``, as loops do."""
    (printed,) = program_variables(replace(program, kernels=(program.kernel(name),)), NUMBA)["kernels"]
    first = "p" if name == "prepare" else "t"
    ways = {"result": "c", "given": "p, out"} if name == "prepare" else {"result": "out", "given": "t[0], y, c, out"}
    return render("numba/kernel.py.j2", {**printed, **ways, "addresses": ", ".join((first, *_ENTRY[1:]))})


def kernel(name: str, made: Kernel, lanes: int = 1, arguments: Sequence[str] = _ENTRY) -> str:
    """Return a kernel as loops call it, of as many cases together as there are lanes."""
    return render("numba/function.py.j2", _function(name, made, lanes, arguments))


def _function(name: str, made: Kernel, lanes: int, arguments: Sequence[str]) -> dict[str, Any]:
    def place(array: str, index: int | None) -> str:
        first = (index or 0) * lanes
        return f"{array}[{first}]" if lanes == 1 else f"{array}[{first} + _lane]"

    return {
        "name": name,
        "arguments": ", ".join(arguments),
        "doc": f"{len(made.outputs)} values, {describe_counts(made)}.",
        "packed": lanes > 1 and bool(made.outputs),
        "lanes": lanes,
        "lines": [
            *(f"{load.target} = {place(load.array, load.index)}" for load in made.loads),
            *map(NUMBA.assignment, made.body),
        ],
        "stores": [{"place": place("out", i), "value": value} for i, value in enumerate(NUMBA.outputs(made))],
    }


def taylor_step(name: str, known: Recurrences, order: int, *, dense: bool) -> str:
    """Return a Taylor step: written out where it is short, else with loops over the orders."""
    if known.unrolled_lines(order) <= _LARGEST_STRAIGHT:
        return kernel(name, step_kernel(known, order, dense=dense))
    return render("numba/taylor.py.j2", taylor_loop(name, known, order, dense=dense))


def attempt(
    rhs: Kernel,
    tableau: Tableau,
    *,
    dense: bool,
    carried: bool,
    knots: Kernel | None = None,
    weighted: bool = False,
) -> str:
    """Return the functions ``attempt`` and ``start`` of `dalembert.transforms.runge_kutta`."""
    own = {"carried": carried, "weighted": weighted}
    if len(rhs.body) * (tableau.n_total if dense else tableau.end + 1) <= _LARGEST_INLINED:
        made = attempt_kernel(rhs, tableau, dense=dense, knots=knots, **own)
        return joined(kernel("attempt", made), kernel("start", start_kernel(rhs, tableau, **own)))
    tries = attempt_pieces(rhs, tableau, dense=dense, knots=knots, **own)
    starts = start_pieces(rhs, tableau, **own)
    texts = [kernel(tries.rhs.name, tries.rhs, 1, ("t", "y", "c", "out"))]
    if tries.knots is not None:
        texts.append(kernel(tries.knots.name, tries.knots, 1, ("t", "y", "c", "out")))
    for pieces in (tries, starts):
        parts = [made for _, made in pieces.stages]
        texts += [kernel(made.name, made, 1, (*made.arguments, "out")) for made in (*parts, pieces.finish)]
        texts.append(render("numba/attempt.py.j2", _chain(pieces, len(rhs.outputs))))
    return joined(*texts)


def entries(functions: Sequence[tuple[str, str]]) -> str:
    """Return LLVM assembly of functions of the C signature, which call compiled ones: pairs of their names."""
    named = [{"name": name, "code": code} for name, code in functions]
    return render("numba/entries.ll.j2", {"entries": named})


def _chain(pieces: AttemptPieces, n: int) -> dict[str, Any]:
    """Return the variables of the function that calls the pieces in turn."""
    return {
        "name": pieces.name,
        "doc": f"{len(pieces.finish.outputs)} values, {len(pieces.stages)} evaluations of the right-hand side.",
        "rhs": pieces.rhs.name,
        "size": 8 * (pieces.held + len(pieces.moved) + 1),
        "slopes": pieces.slopes,
        "limits": pieces.held - pieces.slopes,
        "limiting": [] if pieces.knots is None else [pieces.knots.name],
        "moved": len(pieces.moved),
        "stages": [{"piece": made.name, "slope": stage * n} for stage, made in pieces.stages],
        "finish": pieces.finish.name,
    }
