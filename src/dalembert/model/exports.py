"""Methods of models that take them away: `export` writes simulators, `to_casadi` makes functions of CasADi."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import CapabilityError, OptionError, list_names, nesting_named, unknown_name
from ..options import DEFAULT_TOLERANCES, TIGHTER

if TYPE_CHECKING:
    from .model import CompiledModel


def _c(model: CompiledModel, request: Mapping[str, Any]) -> dict[str, Any]:
    from ..codegen.c.contact_simulator import c_files
    from ..export.simulator import c_source

    return c_files(c_source(model, **request))


def _fmu(model: CompiledModel, request: Mapping[str, Any]) -> dict[str, Any]:
    from ..export.fmu import fmu_files
    from ..export.simulator import c_source

    asked = dict(request)
    platforms, version = asked.pop("platforms"), asked.pop("fmi")
    return fmu_files(c_source(model, **asked, continued=True), platforms, version)


def _page(model: CompiledModel, request: Mapping[str, Any]) -> dict[str, Any]:
    from ..export.page import page_text
    from ..export.simulator import c_source

    asked = dict(request)
    sliders, modes = asked.pop("sliders"), model.modes
    source, (rtol, atol) = c_source(model, **asked), asked["tolerances"]
    asked |= {"tolerances": (rtol * TIGHTER, atol * TIGHTER)} | ({"method": source.method} if modes is None else {})
    scene = model.stages.scene if modes is None else modes.several.scene
    return {"file": page_text(source, c_source(model, **asked), scene, sliders)}


def _wheel(model: CompiledModel, request: Mapping[str, Any]) -> dict[str, Any]:
    from ..export.simulator import c_source
    from ..export.wheel import wheel_files

    return dict(wheel_files(c_source(model, **request)))


def _numba(model: CompiledModel, request: Mapping[str, Any]) -> dict[str, Any]:
    from ..export.numba_file import numba_text
    from ..export.simulator import c_source

    return {"file": numba_text(c_source(model, **request))}


def _jax(model: CompiledModel, request: Mapping[str, Any]) -> dict[str, Any]:
    from ..export.jax_file import jax_text
    from ..export.simulator import c_source

    return {"file": jax_text(c_source(model, **request))}


KINDS: dict[str, Callable[[CompiledModel, Mapping[str, Any]], dict[str, Any]]] = {
    "c": _c,
    "fmu": _fmu,
    "page": _page,
    "wheel": _wheel,
    "numba": _numba,
    "jax": _jax,
}
"""Kinds of exports: from a model and what was asked for to the contents of files by their names."""

ENDINGS = {"fmu": ".fmu", "page": ".html", "numba": ".py", "jax": ".py"}
"""Kinds that are one file, and how its name ends; others are folders."""


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
    rtol: float = DEFAULT_TOLERANCES[0],
    atol: float = DEFAULT_TOLERANCES[1],
    step: float | None = None,
    precision: str = "double",
    fmi: str = "2.0",
    platforms: Sequence[str] | None = None,
    sliders: Mapping[Any, tuple[float, float]] | None = None,
    events: Any = (),
) -> Path:
    """Write a simulator of the model that needs nothing of dalembert.

    Kind "c" is a folder with a header, a source in C99 without allocation and globals, an example ``main.c``, a
    Makefile and a README with all names. It takes the steps of `simulate`, from the same initial values. Kind "fmu" is
    a functional mock-up unit for co-simulation and model exchange around that source, with a binary for this machine
    where it has a C compiler. Kind "page" is one file of HTML that simulates in a browser without a network: that
    source as WebAssembly, sliders, curves, and the shapes of the scene in space. It needs the package ziglang (extra
    "export").
    Kind "wheel" is a folder with a package for this machine that pip installs, and that needs NumPy alone. Kinds
    "numba" and "jax" are one file of Python each, to be read from top to bottom, that needs numba and NumPy, or JAX.

    Parameters
    ----------
    path : str or path
        The folder, or a file that ends in ".fmu", ".html" or ".py". It must not exist, be empty, or be an earlier
        export as it was written, whose place it takes.
    kind : str
        "c", "fmu", "page", "wheel", "numba" or "jax".
    initial : mapping of symbols or names to numbers, optional
        Initial values of the example, and start values of a unit or page. Their names are what the exported start
        takes; what the constraints fix may be left out. By default it takes all coordinates and rates, and the example
        none.
    parameters, inputs : mapping of symbols or names to numbers, optional
        Parameters and constant inputs of the example.
    t_span : (float, float)
        Start and end of the example [s].
    method : str
        "taylor", a Runge-Kutta pair such as "dop853", or "radau" for stiff scenes; "auto" takes what a run
        of the example takes, which is made for that; without an example, what takes runs that are not stiff. Files
        for JAX take "dop853" alone, those for numba no "radau": where "auto" finds a stiff scene, that is an error.
        Kind "c" also has "rk4": steps of a fixed size by the classic Runge-Kutta method of order 4, each of the same
        operations, which the README counts.
    rtol, atol : float
        Tolerances, which the code is made for; "rk4" has none.
    step : float, optional
        Size of the steps of "rk4" [s].
    precision : str
        "double", or for "rk4" also "single": all numbers of the code are then floats.
    fmi : str
        Version of the standard of a unit: "2.0" or "3.0".
    platforms : sequence of str, optional
        Platforms that a unit has binaries for, by the compiler of ziglang (extra "export"): "linux64", "win64",
        "darwin64", and for arm64 "aarch64-linux", "aarch64-darwin". By default this machine, by its own C compiler.
    sliders : mapping of symbols or names to (float, float), optional
        Initial values, parameters and inputs that have a slider on a page, and its ends. By default all have one, about
        the value that is given.
    events : sequence of Event, SymPy expression or str, or one of these
        Events that occur in runs: as in `simulate`, they are counted, end runs, and map the state.

    Returns
    -------
    Path
        The folder or file.

    Raises
    ------
    CapabilityError
        For what a kind does not carry (`dalembert.export.kinds.CARRIED`: events, sampled controllers, contacts and
        tables in some), with the kinds that do; and for what none does, with the remedy: contacts with many modes, laws
        in Python, functions of time with kinks, formulations other than "minimal", "projected" and "augmented".
    OptionError
        For an unknown kind, and a path at which something else is.
    InitialStateError, UnknownNameError, ValueInputError
        For initial values, parameters and inputs that are wrong.

    Examples
    --------
    The pendulum of `Scene`::

        model.export("pendulum", initial={theta: 1, theta.diff(): 0}, parameters={m: 1, l: 1, g: 9.81})
    """
    from ..export.folder import path_of, refuse_other_files, refuse_others, write_archive, write_file, write_folder
    from ..export.requests import ExportOptions, export_request

    asked: Any = kind
    if not isinstance(asked, str) or asked not in KINDS:
        raise OptionError(unknown_name("kind of export", str(kind), KINDS))
    place, ending = path_of(path), ENDINGS.get(kind)
    if ending is None:
        refuse_others(place)
    elif place.suffix != ending:
        raise OptionError(f"the path of this kind of export ends in {ending!r}: give {str(place) + ending!r}")
    else:
        refuse_other_files(place)
    asked_for = ExportOptions(
        kind=kind,
        initial=initial,
        parameters=parameters,
        inputs=inputs,
        t_span=t_span,
        method=method,
        rtol=rtol,
        atol=atol,
        step=step,
        precision=precision,
        fmi=fmi,
        platforms=platforms,
        sliders=sliders,
        events=events,
    )
    model, request = export_request(self, asked_for)
    files = KINDS[kind](model, request)
    if "file" in files:
        return write_file(place, files["file"])
    return write_folder(place, files) if ending is None else write_archive(place, files)


def to_casadi(self: CompiledModel) -> dict[str, Any]:
    """Return the equations as functions of CasADi, for optimal control and estimation.

    They are the expressions that the model runs, and CasADi differentiates them exactly. Arguments are ``t``, ``y`` or
    ``x``, ``p`` and ``u``: the time [s]; the state in the order of ``layout.state``, or coordinates, rates and
    first-order states; the parameters in the order of ``layout.parameters``, without those that stand for inputs; the
    inputs in the order of ``layout.inputs``, constant around the time.

    Returns
    -------
    dict of str to casadi.Function
        Of (t, y, p, u): "rhs" (n_y,), the rate of the state; "expand", coordinates, rates and first-order states;
        "outputs". Of (t, x, p, u): "accelerations" (n_q,), "mass_matrix" (n_q, n_q), "forcing" (n_q,), "energy" (2,):
        kinetic and potential; "constraint_jacobian" (n_c, n_q), "position_residual", "velocity_residual". Those that
        the model does not have are left out.

    Raises
    ------
    MissingExtraError
        Without CasADi.
    CapabilityError
        For scenes whose contacts change, tables, compiled functions, and functions of time with kinks or jumps.

    Examples
    --------
    ::

        functions = model.to_casadi()
        dae = {"x": y, "p": p, "ode": functions["rhs"](0, y, p, [])}
    """
    if self.modes is not None:
        raise CapabilityError(
            f"contacts that change ({list_names(self.contacts)}) have no functions of CasADi: take one mode, as"
            " model.mode(...).to_casadi()"
        )
    from ..interop.casadi_functions import casadi_functions

    return casadi_functions(self.stages.program)
