"""Labelled arrays of results, their attributes and units, and their texts for notebooks."""

from __future__ import annotations

import json
from collections.abc import Container, Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, Generic, TypeVar, final

import numpy as np

from ..arrays import FloatArray
from ..errors import MissingExtraError, OptionError, UnknownNameError, unknown_name
from ..ir.program import Layout
from ..methods.status import Status
from ..naming import acceleration_name
from ..options import atol_attribute
from ..stops.segments import Segments, constants_at
from ..version import __version__

if TYPE_CHECKING:
    import xarray

    from .statistics import RunStatistics, SweepStatistics
    from .sweep import Sweep
    from .trajectory import Trajectory


_OWN_NAMES = ("case", "time", "status", "steps", "t_end")
"""Names that a data set has of its own: results, axes and given values of these names get other ones."""

_OTHER_NAMES = ("", "_value", "_given", "_reduced", "_first", "_last")
"""Endings that tell a name of a data set from that of an axis, a result or another reduction; or those of an event."""


def attributes(
    scene: str, formulation: str, stats: RunStatistics | SweepStatistics, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """Return the attributes of labelled arrays of a run; ``parameters`` becomes JSON text."""
    return {
        "scene": scene,
        "formulation": formulation,
        "method": stats.method,
        "rtol": stats.rtol,
        "atol": atol_attribute(stats.atol),
        "parameters": json.dumps(dict(parameters)),
        "dalembert_version": __version__,
    }


def to_xarray(self: Trajectory, units: Mapping[Any, str] | None = None) -> xarray.Dataset:
    """Return the motion as an ``xarray.Dataset`` over ``time``: coordinates, rates, states, outputs, energy, modes.

    Its attributes are the scene, formulation, status, method, tolerances, parameters (as JSON) and version.

    Parameters
    ----------
    units : mapping of symbols or names to str, optional
        Units of what the data set holds, and of parameters: ``{x: "m", "x_dot": "m/s", "m": "kg"}``.

    Raises
    ------
    MissingExtraError
        Without the package.
    UnknownNameError, OptionError
        For units of what is not there, or that are no texts.
    """
    layout, first = self._layout, self.parts[0]
    data: dict[str, Any] = {name: self[name] for name in dict.fromkeys((*layout.variables, *layout.outputs, "energy"))}
    data |= {f"mode of {contact}": states for contact, states in self.modes.items()}
    c = constants_at(first.c, first.t[:1])[0] if isinstance(first.c, Segments) else first.c
    values = dict(zip(first.program.layout.parameters, c.tolist(), strict=False))
    given = {name: values[name] for name in layout.given if name in values}
    formulation = ", ".join(self._formulations)
    attrs = {"status": self.status.name, **attributes(self.name, formulation, self.stats, given)}
    named: dict[str, Any] = {}
    for name, array in data.items():
        named[value_name(name, named)] = "time", array
    times = {"time": ("time", self.t, {"units": "s"})}
    dataset: xarray.Dataset = xarray_package().Dataset(named, coords=times, attrs=attrs)
    return with_units(dataset, units, layout.aliases, given)


def cases_to_xarray(self: Sweep, units: Mapping[Any, str] | None = None) -> xarray.Dataset:
    """Return the sweep as an ``xarray.Dataset`` over ``case`` or the axes of its grid, and ``time`` if sampled.

    With contacts there are ``phases``, and ``name_mode`` of each contact as a number, whose meaning is in its
    attributes ``flag_values`` and ``flag_meanings``; names that are taken have ``_of_contacts`` behind them.

    Values are those at the samples, or final ones. Where x is an axis or a case's own initial value and a result,
    too, each has a name of its own: the axis is ``x`` and the result ``x_value``; along ``case``, the result is
    ``x`` and the initial value ``x_given``. A result called ``time``, ``case``, ``status``, ``steps`` or ``t_end``
    is ``time_value``, and an axis or given values ``time_given``: the data set has these itself. A reduction whose
    name is taken is ``name_reduced``. Of an event there are ``name_count``, ``name_first`` and ``name_last``, with
    ``_of_event`` behind a name that is taken. The attributes ``flag_values`` and ``flag_meanings`` of
    ``status`` have the meaning of its numbers. Other attributes are as for a trajectory.

    Parameters
    ----------
    units : mapping of symbols or names to str, optional
        Units of what the data set holds, and of parameters.

    Raises
    ------
    MissingExtraError
        Without the package.
    UnknownNameError, OptionError
        For units of what is not there, or that are no texts.
    """
    layout = self._layout
    shape = tuple(len(values) for values in self.axes.values()) or (len(self),)
    dims: tuple[str, ...] = tuple(map(given_name, self.axes)) or ("case",)
    coords: dict[str, Any] = {dim: (dim, values) for dim, values in zip(dims, self.axes.values(), strict=False)}
    times: tuple[str, ...] = ()
    if self.t_eval is not None:
        times, coords["time"] = ("time",), ("time", self.t_eval, {"units": "s"})
    if not self.axes:
        varied = {name: v for name, v in {**self.initial, **self.parameters}.items() if len(v) > 1}
        coords |= {given_name(name, self._names()): ("case", v) for name, v in varied.items()}
    data: dict[str, Any] = {}
    for name, values in self._by_name(dict.fromkeys((*layout.variables, *layout.outputs, "energy"))).items():
        data[value_name(name, {*coords, *data})] = ((*dims, *times), values.reshape(*shape, *values.shape[1:]))
    data["status"] = (dims, self.status.reshape(shape), flags([status.name for status in Status]))
    data |= {name: (dims, counts.reshape(shape)) for name, counts in (("steps", self.steps), ("t_end", self.t))}
    others = {*coords, *dims}
    for name, values in self.reduced.items():
        data[distinct(name, others | data.keys(), "_reduced")] = (dims, values.reshape(shape))
    for name, happened in self.events.items():
        for part in ("count", "first", "last"):
            key = distinct(f"{name}_{part}", others | data.keys(), "_of_event")
            data[key] = (dims, getattr(happened, part).reshape(shape))
    for name, column in _of_contacts(self, shape, dims, times).items():
        data[distinct(name, others | data.keys(), "_of_contacts")] = column
    fixed = {name: float(v[0]) for name, v in self.parameters.items() if len(v) == 1 and np.ndim(v) == 1}
    attrs = attributes(self._name, self._formulation, self.stats, fixed)
    dataset: xarray.Dataset = xarray_package().Dataset(data, coords=coords, attrs=attrs)
    return with_units(dataset, units, layout.aliases, fixed)


def _of_contacts(self: Sweep, shape: tuple[int, ...], dims: tuple[str, ...], times: tuple[str, ...]) -> dict[str, Any]:
    """Return the columns of a data set that say what contacts do; none where they do not change."""
    if not self.modes:
        return {}
    from ..contacts.equations.contact_laws import STATES

    names, columns = ("none", *STATES), dict[str, Any]()
    for contact, found in self.modes.items():
        words, places = np.unique(found, return_inverse=True)
        codes = np.array([names.index(word) for word in words], np.int8)[places]
        columns[f"{contact}_mode"] = ((*dims, *times), codes.reshape(*shape, *found.shape[1:]), flags(names))
    return {"phases": (dims, self.phases.reshape(shape))} | columns


def to_dataframe(self: Trajectory | Sweep) -> Any:
    """Return what `to_xarray` has as a ``pandas.DataFrame``: one row a time, and in sweeps a case or place of the grid.

    Raises
    ------
    MissingExtraError
        Without xarray, which brings pandas.
    """
    return self.to_xarray().to_dataframe()


def distinct(name: str, taken: Container[Any], ending: str) -> str:
    """Return a name, with an ending if it is taken."""
    while name in taken:
        name += ending
    return name


def value_name(name: str, taken: Iterable[str] = ()) -> str:
    """Return the name of a result in a data set: with ``_value`` behind one that is taken, or the data set's own."""
    return distinct(name, {*_OWN_NAMES, *taken}, "_value")


def given_name(name: str, taken: Iterable[str] = ()) -> str:
    """Return the name of an axis or of given values in a data set: with ``_given`` behind one that is taken."""
    return distinct(name, {*_OWN_NAMES, *taken}, "_given")


def flags(names: Sequence[str]) -> dict[str, Any]:
    """Return the attributes by which the CF conventions name the numbers 0, 1, ... of an array."""
    return {"flag_values": list(range(len(names))), "flag_meanings": " ".join(names)}


def with_units(
    dataset: xarray.Dataset, units: Mapping[Any, str] | None, aliases: Mapping[str, str], parameters: Mapping[str, Any]
) -> xarray.Dataset:
    """Return a data set whose variables have units, and whose attribute ``parameter_units`` has those of parameters.

    Parameters
    ----------
    dataset : xarray.Dataset
        Changed in place.
    units : mapping of symbols or names to str, or None
    aliases : mapping of str to str
        Names by the texts of symbols.
    parameters : mapping of str
        Parameters that are no variables of the data set.

    Raises
    ------
    UnknownNameError
        For a name that is neither a variable nor a parameter.
    OptionError
        For units that are no mapping to texts.
    """
    if units is None:
        return dataset
    given: Any = units
    if not isinstance(given, Mapping) or not all(isinstance(unit, str) for unit in given.values()):
        raise OptionError(f"units must map names or symbols to texts, such as {{'x': 'm'}}, not {units!r}")
    fixed = {}
    for key, unit in units.items():
        name = aliases.get(str(key), str(key))
        found = [name + ending for ending in _OTHER_NAMES if name + ending in dataset.variables]
        if name in _OWN_NAMES:  # the quantity of the scene before what a data set has of its own
            found = [place for place in found if place != name] or found
        for variable in found:
            dataset[variable].attrs["units"] = unit
        if name in parameters:
            fixed[name] = unit
        elif not found:
            known = dict.fromkeys([*(str(known) for known in dataset.variables), *parameters])
            raise UnknownNameError(unknown_name("variable", name, known))
    if fixed:
        dataset.attrs["parameter_units"] = json.dumps(fixed)
    return dataset


def request_hint(layout: Layout, name: str) -> str:
    """Return the advice to request a reaction, an acceleration or an energy as an output; empty for other names."""
    kinds = dict.fromkeys(("energy", "kinetic_energy", "potential_energy"), "an energy")
    kinds |= dict.fromkeys(map(acceleration_name, layout.coordinates), "an acceleration")
    kinds |= dict.fromkeys(layout.unknowns, "a reaction of the scene")
    kind = kinds.get(name)
    return f" It is {kind}; request it with compile_model(scene, outputs=[{name!r}])." if kind else ""


def xarray_package() -> Any:
    """Return the package xarray.

    Raises
    ------
    MissingExtraError
        Without it.
    """
    try:
        import xarray
    except ImportError:
        raise MissingExtraError('xarray is needed; install it with: pip install "dalembert[xarray]"') from None
    return xarray


# Arrays and other values by name, with an error that lists the names.

T = TypeVar("T")


@final
class NamedValues(dict[str, T], Generic[T]):
    """Arrays, or other values, by name.

    Parameters
    ----------
    kind : str
        Kind of the values, for messages.
    values : mapping of str
    aliases : mapping of str to str, optional
        Names by the texts of SymPy symbols, which may be given in place of them.

    Raises
    ------
    UnknownNameError
        For a name that is not there.
    """

    def __init__(self, kind: str, values: Mapping[str, T], aliases: Mapping[str, str] | None = None) -> None:
        super().__init__(values)
        self._kind, self._aliases = kind, aliases or {}

    def __missing__(self, key: Any) -> T:
        name = self._aliases.get(str(key), str(key))
        if name in self:
            return self[name]
        raise UnknownNameError(unknown_name(self._kind, name, self))

    def __reduce__(self) -> tuple[Any, ...]:
        return NamedValues, (self._kind, dict(self), self._aliases)


# Texts that notebooks show of results.


def summary(title: str, facts: Iterable[tuple[str, object]], head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return HTML: a title, pairs of a name and a value, and a table."""
    items = "".join(f"<li>{escape(name)}: {escape(str(value))}</li>" for name, value in facts)
    heads = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    table = f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>"
    return f"<div><b>{escape(title)}</b><ul>{items}</ul>{table}</div>"


def ranges(names: Iterable[str], columns: Iterable[FloatArray]) -> list[tuple[str, ...]]:
    """Return name, least, largest and last number of columns of numbers."""
    rows = []
    for name, column in zip(names, columns, strict=True):
        finite = column[np.isfinite(column)]
        cells = (np.min(finite), np.max(finite), column.ravel()[-1]) if finite.size else (np.nan,) * 3
        rows.append((name, *(f"{x:.6g}" for x in cells)))
    return rows
