"""The method of models that writes simulators: `export`."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import CapabilityError, OptionError, list_names, nesting_named, unknown_name
from ..ir.calls import function_of
from ..ir.kernel import calls_in
from ..ir.program import hidden_parameters
from ..options import NamedTolerances, tolerances
from ..starts.inputs import span_of

if TYPE_CHECKING:
    from .model import CompiledModel


def _c(model: CompiledModel, request: Mapping[str, Any]) -> dict[str, Any]:
    from ..codegen.c.simulator import c_files
    from ..export.simulator import c_source

    return c_files(c_source(model, **request))


def _fmu(model: CompiledModel, request: Mapping[str, Any]) -> dict[str, Any]:
    from ..export.fmu import fmu_files
    from ..export.simulator import c_source

    return fmu_files(c_source(model, **request))


KINDS: dict[str, Callable[[CompiledModel, Mapping[str, Any]], dict[str, Any]]] = {"c": _c, "fmu": _fmu}
"""Kinds of exports: from a model and what was asked for to the contents of files by their names."""

ARCHIVES = {"fmu": ".fmu"}
"""Kinds that are one archive, and how its name ends; others are folders."""


@nesting_named
def export(
    self: CompiledModel,
    path: str | os.PathLike[str],
    kind: str = "c",
    *,
    initial: Mapping[Any, Any] | None = None,
    parameters: Mapping[Any, Any] | None = None,
    inputs: Mapping[Any, Any] | None = None,
    t_span: tuple[float, float] = (0.0, 10.0),
    method: str = "auto",
    rtol: float = 1e-8,
    atol: float = 1e-10,
    fmi: str = "2.0",
) -> Path:
    """Write a simulator of the model that needs nothing of dalembert.

    Kind "c" is a folder with a header, a source in C99 without allocation and globals, an example ``main.c``, a
    Makefile and a README with all names. It takes the steps of `simulate`, from the same initial values. Kind "fmu" is
    a functional mock-up unit for co-simulation around that source, with a binary for this machine where it has a C
    compiler.

    Parameters
    ----------
    path : str or path
        The folder, or a file that ends in ".fmu". It must not exist, be empty, or be an earlier export as it was
        written, whose place it takes.
    kind : str
        "c" or "fmu".
    initial : mapping of symbols or names to numbers, optional
        Initial values of the example, and start values of a unit. Their names are what the exported start takes; what
        the constraints fix may be left out. By default it takes all coordinates and rates, and the example none.
    parameters, inputs : mapping of symbols or names to numbers, optional
        Parameters and constant inputs of the example.
    t_span : (float, float)
        Start and end of the example [s].
    method : str
        "taylor", a Runge-Kutta pair such as "dop853", or "radau" for stiff scenes; "auto" takes what a run
        of the example takes, which is made for that; without an example, what takes runs that are not stiff.
    rtol, atol : float
        Tolerances, which the code is made for.
    fmi : str
        Version of a unit: "2.0".

    Returns
    -------
    Path
        The folder or file.

    Raises
    ------
    CapabilityError
        For what exports do not carry, with the remedy: contacts that change, sampled controllers, functions of time
        with kinks, formulations other than "minimal", "projected" and "augmented".
    OptionError
        For an unknown kind, and a path at which something else is.
    InitialStateError, UnknownNameError, ValueInputError
        For initial values, parameters and inputs that are wrong.

    Examples
    --------
    The pendulum of `Scene`::

        model.export("pendulum", initial={theta: 1, theta.diff(): 0}, parameters={m: 1, l: 1, g: 9.81})
    """
    from ..export.folder import path_of, refuse_other_files, refuse_others, write_archive, write_folder

    asked: Any = kind
    if not isinstance(asked, str) or asked not in KINDS:
        raise OptionError(unknown_name("kind of export", str(kind), KINDS))
    place, ending = path_of(path), ARCHIVES.get(kind)
    if ending is None:
        refuse_others(place)
    elif place.suffix != ending:
        raise OptionError(f"the path of this kind of export ends in {ending!r}: give {str(place) + ending!r}")
    else:
        refuse_other_files(place)
    if fmi != "2.0":
        raise OptionError(f"fmi is {fmi!r}: exports are units of FMI '2.0'")
    rtol, atol = tolerances(rtol, atol)
    if isinstance(atol, NamedTolerances):
        raise OptionError("exports take one atol for the whole state, and not tolerances by name: give a number")
    called = [] if self.modes is not None else [key for kernel in self.stages.program for key in calls_in(kernel)]
    if called:
        names = list_names(dict.fromkeys(repr(function_of(key).name) for key in called))
        raise CapabilityError(
            f"compiled functions ({names}) are machine code of this process, which no export can hold: write them in"
            " SymPy or as da.table"
        )
    if rtol == atol == 0.0:
        raise OptionError("rtol and atol must not both be 0: set one of them above 0")
    given = None if initial is None else dict(self.read_initial(initial))
    numbers = dict(given or {})
    if parameters is not None:
        numbers |= self.read_parameters({**dict.fromkeys(_hidden(self), 0.0), **parameters})
    numbers |= _input_values(self, inputs)
    if method == "auto" and _complete(self, numbers, given):
        method = _method_of_example(self, (initial, parameters, inputs), t_span, rtol, atol)
    request = {
        "initial": given,
        "numbers": numbers,
        "method": method,
        "tolerances": (rtol, atol),
        "span": span_of(t_span),
    }
    files = KINDS[kind](self, request)
    return write_folder(place, files) if ending is None else write_archive(place, files)


def _hidden(model: CompiledModel) -> set[str]:
    """Return the parameters that stand for inputs."""
    return {name for u in model.layout.inputs for name in hidden_parameters(u)}


def _complete(model: CompiledModel, numbers: Mapping[str, float], given: Mapping[str, float] | None) -> bool:
    """Return whether an example has all of its numbers."""
    wanted = {*model.layout.parameters, *model.layout.inputs} - _hidden(model)
    return given is not None and model.modes is None and wanted <= set(numbers)


def _method_of_example(
    model: CompiledModel, example: tuple[Any, Any, Any], t_span: tuple[float, float], rtol: float, atol: float
) -> str:
    """Return the method that a run of the example takes, "auto" where it takes several."""
    initial, parameters, inputs = example
    run = model.simulate(
        t_span, initial, parameters or {}, inputs=inputs, rtol=rtol, atol=atol, t_eval=t_span, dense=False
    )
    return run.stats.method if run.stats.method in model.methods else "auto"


def _input_values(model: CompiledModel, inputs: Mapping[Any, Any] | None) -> dict[str, float]:
    """Return the values of constant inputs by name."""
    found: dict[str, float] = {}
    for symbol, value in (inputs or {}).items():
        name = symbol if isinstance(symbol, str) else getattr(getattr(symbol, "func", None), "__name__", str(symbol))
        if name not in model.layout.inputs:
            raise OptionError(unknown_name("input", name, model.layout.inputs))
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise OptionError(f"the input {name!r} of the example must be a finite number, not {value!r}")
        found[name] = float(value)
    return found
