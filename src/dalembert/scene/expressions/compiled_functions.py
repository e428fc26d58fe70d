"""Functions compiled by numba in SymPy expressions: `compiled`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, final

import sympy as sp

from ...errors import ExpressionError, OptionError
from ...ir.calls import CALLS, SYMBOL, CalledFunction, call, key_of, known, registered

_MOST = len(CALLS)
"""Most arguments of a function."""


@final
class Callee(sp.AtomicExpr):  # type: ignore[misc]
    """A compiled function in a SymPy expression."""

    is_commutative: ClassVar[bool] = True
    is_real: ClassVar[bool] = True
    __slots__ = ("function",)
    function: CalledFunction

    def __new__(cls, function: CalledFunction) -> Callee:
        """Return the function as an atom."""
        made: Callee = sp.AtomicExpr.__new__(cls)
        made.function = registered(function)
        return made

    def _hashable_content(self) -> tuple[Any, ...]:
        return (self.function.name, self.function.key)

    def __reduce__(self) -> tuple[Any, ...]:
        return _callee, (self.function.given, self.function.name, self.function.count)

    def sort_key(self, order: Any = None) -> Any:
        """Return the sort key for SymPy."""
        return self.class_key(), (1, (f"{self.function.name} {self.function.key}",)), sp.S.One.sort_key(), sp.S.One

    def _sympystr(self, printer: Any) -> str:
        return self.function.name

    def _latex(self, printer: Any) -> str:
        return str(sp.latex(sp.Symbol(self.function.name)))


@final
class CompiledCall(sp.Function):  # type: ignore[misc]
    """A compiled function of some expressions; its last argument is the `Callee`."""

    nargs = tuple(range(2, _MOST + 2))
    is_real: ClassVar[bool] = True

    @property
    def function(self) -> CalledFunction:
        """The function."""
        callee: Callee = self.args[-1]
        return callee.function

    @property
    def values(self) -> tuple[Any, ...]:
        """What it is a function of."""
        return tuple(self.args[:-1])

    def fdiff(self, argindex: int = 1) -> Any:
        """Return the derivative by an argument; an error where it is not known."""
        return CompiledCall(*self.values, Callee(self.function.slope(argindex - 1)))

    def _eval_evalf(self, prec: int) -> Any:
        points = [x.evalf() for x in self.values]
        if not all(x.is_Float or x.is_Integer for x in points):
            return None
        return sp.Float(call(*map(float, points), self.function.key))

    def call(self, *values: str) -> str:
        """Return the text of a call of one of `TABLE_CALLS`, with the texts of the arguments."""
        return f"compiled_value({', '.join([*values, str(self.function.key)])})"

    def _numpycode(self, printer: Any) -> str:
        return self.call(*map(printer._print, self.values))

    def _sympystr(self, printer: Any) -> str:
        return f"{self.function.name}({', '.join(map(printer._print, self.values))})"

    def _latex(self, printer: Any, exp: str | None = None) -> str:
        name = str(sp.latex(sp.Symbol(self.function.name))) + ("" if exp is None else f"^{{{exp}}}")
        return rf"{name}{{\left({', '.join(map(printer._print, self.values))} \right)}}"


def compiled(f: Any, *x: Any, derivatives: Sequence[Any] | None = None, name: str | None = None) -> sp.Expr:
    """Return a function that numba has compiled, of expressions: a force whose law is a program.

    It may stand in loads and in outputs, wherever `table` may, but not where derivatives of it are needed that are not
    given: in positions, constraints and potentials, in sensitivities and linear models.

    Parameters
    ----------
    f : function compiled by numba
        ``@numba.njit`` or ``@numba.cfunc``; of real numbers, with a real number for its result. It must have no side
        effects, and its value must depend on its arguments alone: it is called at stages of steps, also of those that
        are rejected, and by several threads. The backends "llvm" and "numba" call its machine code, "numpy" the
        function in Python; "jax" cannot.
    *x : SymPy expressions
        Its arguments, 1 to 6: coordinates, rates, time, parameters.
    derivatives : sequence of functions compiled by numba, optional
        Its derivatives by each argument, of the same arguments. "radau" takes differences without them.
    name : str, optional
        Name in messages; by default that of the function.

    Returns
    -------
    sympy.Expr
        Without a power series: runs take other methods than "taylor". An exception in `f` counts as NaN, with which
        a run ends (``NON_FINITE``, or ``STEP_TOO_SMALL`` where the steps towards it become small).

    Raises
    ------
    ExpressionError
        For what is not compiled, does not compile for real numbers, or has another number of arguments.

    Examples
    --------
    A brake with a law of its own, on a body of the frame B::

        import math, numba

        @numba.njit
        def brake(rate, k):
            return -k * math.sin(1.4 * math.atan(8.0 * rate))

        scene.add_loads((B, da.compiled(brake, theta.diff(), m) * N.z))
    """
    label = name if name is not None else getattr(_python(f), "__name__", "f")
    if not x or len(x) > _MOST:
        raise ExpressionError(f"compiled function {label!r}: give 1 to {_MOST} arguments, not {len(x)}")
    values = [_argument(each, label) for each in x]
    given = f if derivatives is None else (f, *_derivatives(derivatives, len(x), label))
    return CompiledCall(*values, _callee(given, label, len(x)))


def _callee(given: Any, label: str, count: int) -> Callee:
    """Return the atom of a function, or of a tuple of it and its derivatives."""
    f, *slopes = given if isinstance(given, tuple) else (given,)
    own = tuple(_compiled(slope, f"{label}_{place}", count, (), slope) for place, slope in enumerate(slopes, 1))
    return Callee(_compiled(f, label, count, own, given))


def _argument(x: Any, label: str) -> sp.Expr:
    try:
        argument = None if isinstance(x, str | bytes) else sp.sympify(x)
    except (sp.SympifyError, TypeError, ValueError, AttributeError):
        argument = None
    if not isinstance(argument, sp.Expr):
        raise ExpressionError(f"compiled function {label!r}: {x!r} is not a SymPy expression; give what it depends on")
    return argument


def _derivatives(given: Any, count: int, label: str) -> tuple[Any, ...]:
    found = tuple(given) if isinstance(given, list | tuple) else (given,)
    if len(found) != count:
        raise OptionError(
            f"compiled function {label!r}: {len(found)} derivatives for {count} arguments; give one for each, in their"
            " order: derivatives=(df_dx, df_dv)"
        )
    return found


def _python(f: Any) -> Callable[..., float] | None:
    """Return the function in Python of what numba has compiled; None for anything else."""
    python = getattr(f, "py_func", None)
    return getattr(f, "_pyfunc", None) if python is None else python


def _compiled(f: Any, label: str, count: int, slopes: tuple[CalledFunction, ...], given: Any) -> CalledFunction:
    """Return a function, compiled for so many real numbers."""
    python = _python(f)
    if python is None:
        raise ExpressionError(
            f"compiled function {label!r}: {f!r} is not compiled by numba; write @numba.njit above its definition, or"
            " write the expression in SymPy, or a da.table of its values"
        )
    names = list(inspect.signature(python).parameters)
    if len(names) != count:
        raise ExpressionError(
            f"compiled function {label!r} takes {len(names)} arguments ({', '.join(names)}), and {count} are given"
        )
    key = key_of(label, python, slopes)
    found = known(key)
    if found is not None:
        return found
    import numba
    from llvmlite import binding

    number, inner = numba.types.float64, numba.njit(python)
    try:
        inner.compile((number,) * count)
        result = inner.overloads[(number,) * count].signature.return_type
        if not isinstance(result, numba.types.Float | numba.types.Integer | numba.types.Boolean):
            raise NotImplementedError(f"its result is {result}, and not a real number")
        code = numba.cfunc(number(*[number] * count))(_wrapped(inner, names))
    except (numba.core.errors.NumbaError, NotImplementedError) as error:
        said = next((line for line in str(error).splitlines() if line.strip()), "")
        raise ExpressionError(
            f"compiled function {label!r} cannot be compiled as a real function of {count} real numbers: {said}"
        ) from None
    binding.add_symbol(f"{SYMBOL}{key}", code.address)
    return registered(CalledFunction(label, count, python, code.ctypes, code.address, slopes, given, key, code))


def _wrapped(inner: Any, names: Sequence[str]) -> Callable[..., float]:
    """Return a function that calls another, with NaN where that raises."""
    arguments = ", ".join(f"a{i}" for i in range(len(names)))
    lines = [
        f"def called({arguments}):",
        "    try:",
        f"        return float(inner({arguments}))",
        "    except Exception:",
        "        return nan",
    ]
    space: dict[str, Any] = {"inner": inner, "nan": float("nan")}
    exec("\n".join(lines), space)
    found: Callable[..., float] = space["called"]
    return found
