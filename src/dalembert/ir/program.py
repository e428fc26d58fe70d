"""`Program`: kernels of straight-line code in SSA form, without SymPy and the graph, and its text form."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field
from functools import cached_property
from typing import Any, final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from ..naming import rate_name
from ..once import once
from .conditions import CONDITION_TIME, Conditions
from .kernel import Kernel
from .notation import Reader, word
from .ops import TABLE_OPERATIONS
from .program_fields import LAYOUT_FIELDS, PROGRAM_FIELDS, field_lines, read_fields, read_table, table_text
from .surfaces import Surface
from .tables import PieceNumbers, numbers_of

# Decay rates of constraint violations, which follow the direction of time.

DECAY_RATE = "baumgarte_alpha"
"""Parameter of the formulation `baumgarte` whose sign decides whether violations decay or grow."""

FIXED_GAINS = ("fixed baumgarte_alpha", "fixed baumgarte_beta")
"""Parameters of gains that are given with the formulation. Users do not give them; runs set the sign of the first."""


def decay_rate_among(names: Iterable[str]) -> str | None:
    """Return the parameter that is a decay rate of violations, None where there is none."""
    return next((name for name in names if name in (DECAY_RATE, FIXED_GAINS[0])), None)


def directed_rates(rates: Any, backward: Any, xp: Any = np) -> Any:
    """Return decay rates (k,) with which violations decay: -|rate| in runs `backward` (k,) in time.

    `xp` is the namespace of the arrays: numpy, or jax.numpy.
    """
    return xp.where(backward, -xp.abs(rates), rates)


def along_run(names: Sequence[str], p: FloatArray, *, backward: bool) -> FloatArray:
    """Return parameters p (n_p,) with which violations decay in a run backward in time, too."""
    rate = decay_rate_among(names)
    if not backward or rate is None:
        return p
    place, p = names.index(rate), p.copy()
    p[place] = directed_rates(p[place], backward)
    return p


# Hidden parameters of the inputs of a program: each input is a polynomial in time between two knots.

DEGREE = 3
"""Degree of the polynomials."""

WIDTH = DEGREE + 2
"""Parameters of one input: the time of its knot, then the coefficients, that of the constant first."""


def hidden_parameters(name: str) -> tuple[str, ...]:
    """Return the names of the parameters of an input.

    With them at k, u_0, u_1, ..., the input is u_0 + u_1 s + u_2 s^2 + ... of s = t - k. Runs set them at every knot,
    so they stand in the constants as they are, and nothing that depends on them is computed once a run.
    """
    return (f"time of the knot of {name}", *(f"coefficient {k} of {name}" for k in range(DEGREE + 1)))


def coefficient_places(parameters: tuple[str, ...], inputs: tuple[str, ...]) -> tuple[int, ...]:
    """Return the place of the first parameter of each input among the parameters, and so among the constants."""
    return tuple(parameters.index(hidden_parameters(name)[0]) for name in inputs)


DIRECTION = "direction of time"
"""Name of the value 1 or -1 from which a start knows which way the motion runs; without it, forwards."""


@final
@frozen
class KnotSides:
    """Kernels of states on knots of tables and on switches (`reduction.knot_starts`).

    Attributes
    ----------
    near : Kernel
        1 where a state is on one, else 0: a state that is on none is that of `sides`.
    sides : Kernel
        The state with which the motion continues, forwards and backwards in time.
    """

    near: Kernel
    sides: Kernel


@final
@frozen
class Layout:
    """Names of the entries of the arrays of a program.

    Attributes
    ----------
    coordinates, rates, parameters, unknowns : tuple of str
        Names of q, q_dot, p and of the reaction components. Among the parameters are some that runs set themselves,
        for inputs, conditions on time and gains given to the compiler; `given` lists those that users give.
    state : tuple of str
        Names of the components of y.
    outputs : tuple of str
        Names of the requested outputs.
    constraints : tuple of str
        Labels of the constraints, holonomic ones first.
    holonomic : int
        Number of holonomic constraints.
    constants : int
        Length of c: the parameters, then the expressions of parameters alone; 0 before these are hoisted.
    aliases : mapping of str to str
        Text of a SymPy symbol -> name.
    defaults : mapping of str to float
        Parameters that may be left out, and their values then.
    entries : tuple of str
        Names of other values that a start may be given in.
    assumptions : mapping of str to tuple of str
        Name -> what its symbol was declared to be, such as "positive".
    inputs : tuple of str
        Names of the inputs; each has parameters of its own (`hidden_parameters`).
    states : tuple of str
        Names of the first-order states, which are the last components of y.
    held : tuple of str
        Names of the inputs that controllers set and hold, which are among the states.
    angles : tuple of str
        Coordinates without a unit: angles and components of quaternions.
    """

    coordinates: tuple[str, ...]
    rates: tuple[str, ...]
    parameters: tuple[str, ...]
    unknowns: tuple[str, ...]
    undetermined: tuple[str, ...]
    state: tuple[str, ...]
    outputs: tuple[str, ...]
    constraints: tuple[str, ...]
    holonomic: int
    constants: int
    aliases: dict[str, str] = field(hash=False)
    defaults: dict[str, float] = field(default_factory=dict, hash=False)
    entries: tuple[str, ...] = ()
    assumptions: dict[str, tuple[str, ...]] = field(default_factory=dict, hash=False)
    inputs: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    held: tuple[str, ...] = ()
    angles: tuple[str, ...] = ()

    @cached_property
    def given(self) -> tuple[str, ...]:
        """Names of the parameters that users give: all that runs do not set themselves."""
        own = {name for u in self.inputs for name in hidden_parameters(u)} | {CONDITION_TIME, *FIXED_GAINS}
        return tuple(name for name in self.parameters if name not in own)

    @cached_property
    def set_by_runs(self) -> frozenset[str]:
        """Names of the parameters that runs set themselves."""
        return frozenset(self.parameters) - frozenset(self.given)

    @cached_property
    def decay_rate(self) -> str | None:
        """The parameter that is a decay rate of violations, None where there is none."""
        return decay_rate_among(self.parameters)

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of coordinates, rates and first-order states."""
        return (*self.coordinates, *self.rates, *self.states)

    @property
    def state_rates(self) -> tuple[str, ...]:
        """Names of the rates of the first-order states."""
        return tuple(map(rate_name, self.states))

    @property
    def initial(self) -> tuple[str, ...]:
        """Names that initial values may have."""
        return (*self.variables, *self.entries)


@final
@frozen
class Program:
    """The kernels of one scene in one formulation, and the layout of their arrays.

    Where the scene is `nonanalytic`, what its series do not show may happen in reactions, too, that no rate depends on.
    `energy_note` is the warning for requests of the energy.
    `conditions` are those that are decided once for each segment of a run, None where there are none.

    ``str(program)`` is its text for people to read, in the notation of `dalembert.ir.notation`: what the arrays hold,
    then the kernels, the outputs commented by what they are. ``Program.parse(str(program)) == program``.
    """

    name: str
    formulation: str
    layout: Layout
    kernels: tuple[Kernel, ...]
    notes: tuple[str, ...]
    nonanalytic: bool = False
    energy_note: str = ""
    conditions: Conditions | None = None

    @property
    def stops_at_tables(self) -> bool:
        """Whether steps end at knots of tables that rates depend on."""
        return "knots" in self and any(line.op == "piece" for line in self.kernel("knots").body)

    @property
    def knot_sides(self) -> KnotSides | None:
        """The kernels that take a state off knots of tables and switches, None without any."""
        return KnotSides(self.kernel("near_knots"), self.kernel("knot_sides")) if "knot_sides" in self else None

    @property
    def tables(self) -> tuple[PieceNumbers, ...]:
        """The tables and surfaces that kernels read, in the order in which they occur; axes before their surface."""
        functions = self.kernels if self.conditions is None else (*self.kernels, *self.conditions.kernels)
        keys = [line.args[1] for kernel in functions for line in kernel.body if line.op in TABLE_OPERATIONS]
        found = [numbers_of(key) for key in dict.fromkeys(keys) if not isinstance(key, str)]
        needed = [(*each.axes, each) if isinstance(each, Surface) else (each,) for each in found]
        return tuple({each.key: each for group in needed for each in group}.values())

    def __str__(self) -> str:
        fields = field_lines(PROGRAM_FIELDS, self) + field_lines(LAYOUT_FIELDS, self.layout)
        parts = ["\n".join([f"program {word(self.name)}", *fields])]
        parts += map(table_text, self.tables)
        parts += [kernel.text(_output_labels(self.layout, kernel)) for kernel in self.kernels]
        if self.conditions is not None:
            parts.append(str(self.conditions))
        return "\n\n".join(parts) + "\n"

    @classmethod
    def parse(cls, text: str) -> Program:
        """Return the program of which `text` is the text form; `dalembert.ir.kernel` checks its kernels.

        Raises
        ------
        ProgramTextError
            With the line that cannot be read, and what was expected there.
        """
        reader = Reader(text)
        reader.require("program")
        name = reader.word("the name of the program")
        reader.end_line()
        values = read_fields(reader, {**PROGRAM_FIELDS, **LAYOUT_FIELDS})
        layout = Layout(**{key: value for key, value in values.items() if key in LAYOUT_FIELDS})
        while reader.sees("table") or reader.sees("surface"):
            read_table(reader)
        kernels = []
        while reader.sees("kernel"):
            kernels.append(Kernel.read(reader))
        conditions = Conditions.read(reader) if reader.sees("conditions") else None
        if not reader.done:
            reader.fail("'table', 'surface', 'kernel', 'conditions' or the end")
        own = {key: value for key, value in values.items() if key in PROGRAM_FIELDS}
        return cls(name=name, layout=layout, kernels=tuple(kernels), conditions=conditions, **own)

    def kernel(self, name: str) -> Kernel:
        """Return the kernel called `name`; ``KeyError`` where there is none."""
        for kernel in self.kernels:
            if kernel.name == name:
                return kernel
        raise KeyError(name)

    @cached_property
    def projects(self) -> bool:
        """Whether states are projected onto constraints."""
        return "project_position" in self or "project_velocity" in self

    def __contains__(self, name: object) -> bool:
        return any(kernel.name == name for kernel in self.kernels)

    def __iter__(self) -> Iterator[Kernel]:
        return iter(self.kernels)


def _output_labels(layout: Layout, kernel: Kernel) -> list[str]:
    """Return labels of the outputs of a kernel of a program, where they are known."""
    q, qdot = layout.coordinates, layout.rates
    rows = [f"constraint {i}" for i in range(1, len(layout.constraints) + 1)]
    labels: dict[str, list[str]] = {
        "rhs": [f"rate of {name}" for name in layout.state],
        "expand": list(layout.variables),
        "outputs": list(layout.outputs),
        "initial": list(layout.state),
        "mass_matrix": [f"{a}, {b}" for a in q for b in q],
        "momenta": list(q),
        "forcing": list(q),
        "accelerations": [f"rate of {name}" for name in qdot],
        "constraint_jacobian": [f"{row}, {name}" for row in rows for name in qdot],
        "position_residual": rows[: layout.holonomic],
        "velocity_residual": rows,
    }
    known = labels.get(kernel.name, [])
    return known if len(known) == len(kernel.outputs) else []


@once
def representative(program: Program) -> Program:
    """Return the first of all equal programs, so that equal representatives are the same object."""
    return program
