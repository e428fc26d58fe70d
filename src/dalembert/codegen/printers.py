"""Printers: an operation of the IR as an expression of a target language.

A printer is a table with one format string an operation; a test asserts that every table covers
every operation. Python's `repr` of a float is exact, so no digit of a literal is lost.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from typing import final

from ..frozen import frozen
from ..ir.calls import CALLS
from ..ir.kernel import Assignment, Kernel, Load, Operand
from ..ir.ops import TABLE_OPERATIONS
from ..transforms.taylor.nonsmooth import only_in_branches

_UNGUARDED = (
    *("add", "sub", "neg", "select", "min", "max", "less", "less_equal", "sign", "floor"),
    *("piece", "entry"),
)
"""Operations whose derivatives are numbers wherever they are taken, or that have none."""


@final
@frozen
class Printer:
    """Prints the lines of a kernel.

    Attributes
    ----------
    name : str
    formats : mapping of str to str
        One an operation.
    guard : str
        Name of what applies a function that only branches of selections use (`only_in_branches`); empty where it does
        not matter, because nothing is differentiated.
    products : str
        Format of such a product of two values, which is by far the most frequent; of others `guard` is good enough.
    special : mapping of float to str
        Literals of numbers whose `repr` is none.
    """

    name: str
    formats: Mapping[str, str]
    guard: str = ""
    products: str = ""
    special: Mapping[float, str] = field(default_factory=dict)

    def operand(self, operand: Operand) -> str:
        """Return a name or an exact literal."""
        if isinstance(operand, str):
            return operand
        text = self.special.get(operand) or repr(operand)
        return f"({text})" if operand < 0 else text

    def load(self, load: Load) -> str:
        """Return the line that loads an input."""
        return f"{load.target} = {load.array}" + ("" if load.index is None else f"[{load.index}]")

    def assignment(self, line: Assignment) -> str:
        """Return the line of an operation."""
        return f"{line.target} = " + self.expression(line.op, *map(self.operand, line.args))

    def expression(self, op: str, *operands: str) -> str:
        """Return an operation on operands that are printed; names of tables are whole numbers."""
        if op in CALLS:
            operands = (*operands[:-1], str(int(float(operands[-1]))))
        elif op in TABLE_OPERATIONS:
            operands = (operands[0], *(str(int(float(number))) for number in operands[1:]))
        return self.formats[op].format(*operands)

    def guarded(self, line: Assignment) -> str:
        """Return the line of an operation that only branches of selections use."""
        factors = line.args[:2] if line.op in ("mul", "fma") else line.args[1:]
        linear = line.op in ("mul", "fma", "div") and not all(isinstance(factor, str) for factor in factors)
        if line.op in _UNGUARDED or linear:
            return self.assignment(line)
        if line.op in ("mul", "fma"):
            rest = "".join(f" + {self.operand(arg)}" for arg in line.args[2:])
            return f"{line.target} = " + self.products.format(*map(self.operand, factors)) + rest
        names = tuple(dict.fromkeys(arg for arg in line.args if isinstance(arg, str)))
        expression = self.formats[line.op].format(*map(self.operand, line.args))
        return f"{line.target} = {self.guard}(lambda {', '.join(names)}: {expression}, {', '.join(names)})"

    def lines(self, kernel: Kernel, in_branches: frozenset[str] | None = None) -> list[str]:
        """Return the body of a kernel without its outputs.

        `in_branches` holds the targets that only branches use, where `kernel` is part of a longer one.
        """
        chosen = in_branches if in_branches is not None or not self.guard else only_in_branches(kernel)
        if not self.guard or not chosen:
            return [*map(self.load, kernel.loads), *map(self.assignment, kernel.body)]
        body = (self.guarded(line) if line.target in chosen else self.assignment(line) for line in kernel.body)
        return [*map(self.load, kernel.loads), *body]

    def outputs(self, kernel: Kernel) -> list[str]:
        """Return the outputs of a kernel."""
        return [self.operand(output) for output in kernel.outputs]


_ARITHMETIC = {"add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "div": "{} / {}", "neg": "-{}"}
_FUNCTIONS = (
    "sqrt",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "atan2",
    "exp",
    "log",
    "sinh",
    "cosh",
    "tanh",
    "pow",
)

PYTHON = Printer(
    "python",
    {
        **_ARITHMETIC,
        **{
            name: f"math.{name}({{}}, {{}})" if name in ("atan2", "pow") else f"math.{name}({{}})"
            for name in _FUNCTIONS
        },
        "floor": "float(math.floor({}))",
        "abs": "abs({})",
        "sign": "(1.0 if {0} > 0.0 else (-1.0 if {0} < 0.0 else 0.0))",
        "min": "min({}, {})",
        "max": "max({}, {})",
        "less": "(1.0 if {} < {} else 0.0)",
        "less_equal": "(1.0 if {} <= {} else 0.0)",
        "select": "({1} if {0} != 0.0 else {2})",
        "piece": "tables.piece({}, {})",
        "entry": "tables.entry({}, {}, {})",
        **{op: f"calls.call({', '.join(['{}'] * (count + 1))})" for op, count in CALLS.items()},
    },
)
"""Scalar Python with the ``math`` module, and `dalembert.ir.tables`."""

NUMBA = Printer(
    "numba",
    {
        **PYTHON.formats,
        "floor": "_floor({})",
        "sign": "_sign({})",
        "min": "_minimum({}, {})",
        "max": "_maximum({}, {})",
        "less": "_less({}, {})",
        "less_equal": "_less_equal({}, {})",
        "select": "_select({}, {}, {})",
        "piece": "_piece_{1}({0})",
        "entry": "_table_{1}_{2}(int({0}))",
        **{op: f"_call_{{{n}}}({', '.join(f'{{{i}}}' for i in range(n))})" for op, n in CALLS.items()},
        "fma": "_fma({}, {}, {})",
        "rough_log2": "_rough_log2({})",
        "rough_exp2": "_rough_exp2({})",
    },
)
"""Scalar Python for numba, with the functions that ``numba/prelude.py.j2`` defines under names that no value has."""

NUMPY = Printer(
    "numpy",
    {
        **PYTHON.formats,
        "div": "math.divide({}, {})",
        "floor": "math.floor({})",
        "piece": "math.piece({}, {})",
        "entry": "math.entry({}, {}, {})",
        **{op: f"math.call({', '.join(['{}'] * (count + 1))})" for op, count in CALLS.items()},
    },
)
"""Scalar Python on `dalembert.ir.ieee`, which it imports as ``math``."""

_JNP_NAMES = {"atan": "arctan"}
_GUARDED_NAMES = {"sqrt": "sqrt", "pow": "power", "asin": "asin", "acos": "acos", "atan2": "atan2"}

JAX = Printer(
    "jax",
    {
        **_ARITHMETIC,
        **{name: f"jnp.{_JNP_NAMES.get(name, name)}({{}})" for name in _FUNCTIONS if name not in _GUARDED_NAMES},
        **{
            name: f"fn.{function}({{}}, {{}})" if name in ("atan2", "pow") else f"fn.{function}({{}})"
            for name, function in _GUARDED_NAMES.items()
        },
        "floor": "jnp.floor({})",
        "abs": "jnp.abs({})",
        "sign": "jnp.sign({})",
        "min": "jnp.minimum({}, {})",
        "max": "jnp.maximum({}, {})",
        "less": "jnp.where({} < {}, 1.0, 0.0)",
        "less_equal": "jnp.where({} <= {}, 1.0, 0.0)",
        "select": "jnp.where({} != 0.0, {}, {})",
        "piece": "fn.piece({}, {})",
        "entry": "fn.entry({}, {}, {})",
    },
    guard="fn.guarded",
    products="fn.product({}, {})",
)
"""Traced JAX, on ``jax.numpy`` and on `dalembert.jax.functions`, which it imports as ``fn``."""

JAX_STEPS = Printer(
    "jax steps",
    {
        **JAX.formats,
        "sqrt": "jnp.sqrt({})",
        "fma": "{} * {} + {}",
        "rough_log2": "jnp.log2({})",
        "rough_exp2": "jnp.exp2({})",
    },
)
"""Steps of integrators in traced JAX."""

JAX_SERIES = Printer("jax series", {**JAX_STEPS.formats, "sqrt": JAX.formats["sqrt"]}, JAX.guard, JAX.products)
"""Parts of these steps that JAX differentiates."""

C = Printer(
    "c",
    {
        **_ARITHMETIC,
        **{name: f"{name}({{}}, {{}})" if name in ("atan2", "pow") else f"{name}({{}})" for name in _FUNCTIONS},
        "floor": "floor({})",
        "abs": "fabs({})",
        "sign": "({0} < 0.0 ? -1.0 : {0} > 0.0 ? 1.0 : 0.0)",
        "min": "({0} < {1} ? {0} : {1})",
        "max": "({0} > {1} ? {0} : {1})",
        "less": "({} < {} ? 1.0 : 0.0)",
        "less_equal": "({} <= {} ? 1.0 : 0.0)",
        "select": "({} != 0.0 ? {} : {})",
        "piece": "piece_{1}({0})",
        "entry": "table_{1}_{2}[(int64_t){0}]",
        "fma": "fused({}, {}, {})",
        "rough_log2": "rough_log2({})",
        "rough_exp2": "rough_exp2({})",
    },
    special={math.inf: "INFINITY", -math.inf: "-INFINITY"},
)
"""C99, with the functions that ``c/prelude.c.j2`` defines."""

PRINTERS = (PYTHON, NUMPY, JAX)
