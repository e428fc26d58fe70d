"""Parts of a motion, each in one program: states, continuous output, and values by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import EnergyWarning, OptionError, warn_caller
from ..frozen import frozen
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..steps.dense_output import DenseOutput
from ..steps.projection import projected
from ..stops.segments import Constants, Segments, constants_at
from ..transforms.taylor.periodic import angles_in
from .shared_loads import output_rows

if TYPE_CHECKING:
    from ..scene import Scene

ENERGIES = ("energy", "kinetic_energy", "potential_energy")

Monitors = Callable[[FloatArray, FloatArray, FloatArray], dict[str, FloatArray]]


def warn_of_energy(program: Program, name: str) -> None:
    """Warn that a requested energy lacks the potential of some loads."""
    if program.energy_note and name != "kinetic_energy":
        warn_caller(program.energy_note, EnergyWarning)


@final
@frozen
class Phase:
    """A phase of a motion from `t0` to `t1` [s]; `modes` has the state of each contact: slip, stick, closed or open."""

    t0: float
    t1: float
    modes: Mapping[str, str]


@final
class Part:
    """A part of a motion in one program, or some of its rows; values are computed on first use.

    Parameters
    ----------
    program : Program
    constants : Constants
        Constants of the program along the motion.
    t : ndarray (n_t,)
        Times [s] of the model that ran.
    y : ndarray (n_t, n_y)
        States.
    dense : DenseOutput, optional
        The motion between the times.
    end : float, optional
        Time that the run reached, where that is neither the last of `t` nor of `dense`.
    scene : Scene, optional
        What the motion is of, for pictures.
    monitors : function, optional
        Computes first integrals from (c, t, x).
    wrapped : ndarray (n_t, n_y), optional
        States whose angles are less whole turns; functions of period 2 pi are computed from them, with smaller rounding
        errors.

    Attributes
    ----------
    phase : Phase or None
        The phase that it lies in; None where contacts do not change.
    opened : tuple of str or None
        With a phase, for each constraint of the scene the name of the contact that is open instead, or None.
    closed : tuple of str or None
        The same of the contact that is closed, where the program has no constraint for it.
    """

    phase: Phase | None = None
    opened: tuple[str | None, ...] = ()
    closed: tuple[str | None, ...] = ()

    def __init__(
        self,
        program: Program,
        constants: Constants,
        t: FloatArray,
        y: FloatArray,
        dense: DenseOutput | None = None,
        end: float | None = None,
        scene: Scene | None = None,
        monitors: Monitors | None = None,
        wrapped: FloatArray | None = None,
    ) -> None:
        self.program, self.c, self.t, self.y, self.dense, self.end = program, constants, t, y, dense, end
        self.scene, self.monitors, self.wrapped = scene, monitors, wrapped

    # -- the same motion elsewhere ---------------------------------------------------------

    def in_phase(
        self, phase: Phase | None, opened: tuple[str | None, ...], closed: tuple[str | None, ...] = ()
    ) -> Part:
        """Return this part in a phase."""
        found = object.__new__(Part)
        found.__dict__.update(self.__dict__, phase=phase, opened=opened, closed=closed)
        return found

    def at(self, t: FloatArray, y: FloatArray, dense: DenseOutput | None = None) -> Part:
        """Return states y (k, n_y) of this scene at times t (k,) of the model that ran."""
        end = self.end if self.dense is None else float(self.dense.knots[-1])
        found = Part(self.program, self.c, t, y, dense, end, self.scene, self.monitors)
        return found.in_phase(self.phase, self.opened, self.closed) if self.phase is not None else found

    def rows(self, some: NDArray[np.intp]) -> Part:
        """Return some of the rows, by number (k,)."""
        return self.at(self.t[some], self.y[some])

    def __call__(self, t: FloatArray) -> Part:
        """Return the motion at times t (k,) of the model that ran; a phase that takes no time has one state.

        Raises
        ------
        OptionError
            Outside the span of the run, or without continuous output.
        """
        if self.phase is not None and self.phase.t0 == self.phase.t1 and len(self.t):
            return self.rows(np.full(len(t), len(self.t) - 1))
        if self.dense is None:
            raise OptionError("this run kept no dense output; simulate with dense=True to evaluate between its times")
        return self.at(t, projected(self.program, self.c, t, self.dense(t)), self.dense)

    @property
    def span(self) -> tuple[float, float]:
        """When it begins and ends [s], for parts that can be evaluated and those of phases."""
        if self.phase is not None:
            return self.phase.t0, self.phase.t1
        assert self.dense is not None
        return float(self.dense.knots[0]), float(self.dense.knots[-1])

    @property
    def t_end(self) -> float:
        """Time that the run reached [s]; that of the last row where it is not known."""
        end = self.end if self.dense is None else float(self.dense.knots[-1])
        if end is None:
            end = float(self.t[-1]) if len(self.t) else float("nan")
        return end

    @property
    def modes(self) -> Mapping[str, str]:
        """The state of each contact; empty without a phase."""
        return {} if self.phase is None else self.phase.modes

    # -- values along it -------------------------------------------------------------------

    @property
    def constants(self) -> FloatArray:
        """The constants (n_c,), or (n_t, n_c) where they change along the motion."""
        return constants_at(self.c, self.t)

    @cached_property
    def expanded(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates and rates (n_t, n_q)."""
        size, kernel, c = len(self.program.layout.coordinates), self.program.kernel("expand"), self.constants
        x = interpret_rows(kernel, self.t, self.y, c)
        rates = slice(size, 2 * size)
        if self.wrapped is None:
            return x[:, :size], x[:, rates]
        return x[:, :size], interpret_rows(kernel, self.t, self._states(kernel, size), c)[:, rates]

    @property
    def variables(self) -> FloatArray:
        """Coordinates, rates and first-order states (n_t, 2 n_q + n_z)."""
        return np.hstack([*self.expanded, self.y[:, self.y.shape[1] - len(self.program.layout.states) :]])

    @cached_property
    def outputs(self) -> FloatArray:
        """Requested outputs (n_t, n_outputs)."""
        kernel = self.program.kernel("outputs")
        return output_rows(self.program, self.t, self._states(kernel), self.constants)

    @cached_property
    def state_rates(self) -> FloatArray:
        """Rates of the first-order states (n_t, n_z)."""
        rates = self._of_states("rhs")
        return rates[:, rates.shape[1] - len(self.program.layout.states) :]

    @cached_property
    def energies(self) -> FloatArray:
        """Kinetic and potential energy (n_t, 2)."""
        return self._of_variables("energy")

    @cached_property
    def velocity_residuals(self) -> FloatArray:
        """Velocity residual of each constraint (n_t, n_constraints)."""
        return self._of_variables("velocity_residual")

    @cached_property
    def residuals(self) -> FloatArray:
        """Constraint residuals (n_t, n_constraints): positions of holonomic, velocities of nonholonomic ones."""
        velocities = self.velocity_residuals[:, self.program.layout.holonomic :]
        return np.hstack([self._of_variables("position_residual"), velocities])

    @property
    def violation(self) -> FloatArray:
        """Residuals of the constraints of the scene (n_t, n_constraints); of an open contact, its penetration."""
        if self.phase is None:
            return self.residuals
        found, of_open = iter(self.residuals.T), lambda name: np.minimum(self._output(f"gap of {name}"), 0.0)
        return self._of_constraints(found, of_open, lambda name: self._output(f"gap of {name}"))

    @property
    def velocity_violation(self) -> FloatArray:
        """Velocity residuals of the constraints of the scene (n_t, n_constraints); none of an open contact."""
        if self.phase is None:
            return self.velocity_residuals
        found, nothing = iter(self.velocity_residuals.T), np.zeros(len(self.t))
        return self._of_constraints(found, lambda name: nothing, lambda name: self._output(f"gap rate of {name}"))

    def _output(self, name: str) -> FloatArray:
        """Return a requested output (n_t,)."""
        return self.outputs[:, self.program.layout.outputs.index(name)]

    def _of_constraints(
        self, own: Iterator[FloatArray], of_open: Callable[[str], FloatArray], of_closed: Callable[[str], FloatArray]
    ) -> FloatArray:
        """Return values (n_t, n_constraints), of contacts where a constraint of the scene is none of the program."""
        columns = [
            of_open(opened) if opened is not None else next(own) if closed is None else of_closed(closed)
            for opened, closed in zip(self.opened, self.closed or (None,) * len(self.opened), strict=True)
        ]
        return np.array(columns).T.reshape(len(self.t), len(columns))

    @property
    def invariants(self) -> dict[str, FloatArray]:
        """First integrals along it (n_t,) by name."""
        if self.monitors is None:
            raise OptionError("this motion has no scene; use one that simulate returned")
        return self.monitors(self.constants, self.t, self.variables)

    def named(self, key: str) -> FloatArray | None:
        """Return something by its name, or another name of it (n_t,); None for an unknown name."""
        layout = self.program.layout
        name = layout.aliases.get(key, key)
        for place, names in enumerate((layout.coordinates, layout.rates)):
            if name in names:
                return self.expanded[place][:, names.index(name)].copy()
        if name in layout.state:
            return self.y[:, layout.state.index(name)].copy()
        for output in (name, key):
            if output in layout.outputs:
                return self.outputs[:, layout.outputs.index(output)].copy()
        if name in layout.state_rates:
            return self.state_rates[:, layout.state_rates.index(name)].copy()
        if name not in ENERGIES:
            return None
        warn_of_energy(self.program, name)
        kinetic, potential = self.energies.T
        found: dict[str, FloatArray] = {
            "energy": kinetic + potential,
            "kinetic_energy": kinetic,
            "potential_energy": potential,
        }
        return found[name]

    def _states(self, kernel: Kernel, first: int = 0) -> FloatArray:
        """Return the states, wrapped where the outputs of a kernel from number `first` on have that period."""
        if self.wrapped is None:
            return self.y
        places = sorted(angles_in(kernel, first))
        y = self.y.copy()
        y[:, places] = self.wrapped[:, places]
        return y

    def _of_states(self, name: str) -> FloatArray:
        """Return the outputs of a kernel of times, states and constants."""
        kernel = self.program.kernel(name)
        return interpret_rows(kernel, self.t, self._states(kernel), self.constants)

    def _of_variables(self, name: str) -> FloatArray:
        """Return the outputs of a kernel of times, `variables` and constants; without columns where there is none."""
        if name not in self.program:
            return np.empty((len(self.t), 0))
        kernel, x, layout = self.program.kernel(name), self.variables, self.program.layout
        if self.wrapped is not None:
            for i in angles_in(kernel):
                if i < len(layout.coordinates) and layout.coordinates[i] in layout.state:
                    x[:, i] = self.wrapped[:, layout.state.index(layout.coordinates[i])]
        return interpret_rows(kernel, self.t, x, self.constants)


def joined_variables(parts: Sequence[Part]) -> FloatArray:
    """Return the variables of parts one after the other, those of one program computed together."""
    found = [np.empty((0, 0))] * len(parts)
    together: dict[int, list[int]] = {}
    for i, part in enumerate(parts):
        if isinstance(part.c, Segments) or part.c.ndim != 1 or part.wrapped is not None:
            found[i] = part.variables
        else:
            together.setdefault(id(part.program), []).append(i)
    for some in together.values():
        own = [parts[i] for i in some]
        if len(own) == 1:
            found[some[0]] = own[0].variables
            continue
        t, y = np.concatenate([part.t for part in own]), np.concatenate([part.y for part in own])
        sizes = [len(part.t) for part in own]
        c = np.repeat(np.array([part.c for part in own]), sizes, axis=0)
        values = Part(own[0].program, c, t, y).variables
        for i, last, size in zip(some, np.cumsum(sizes).tolist(), sizes, strict=True):
            found[i] = values[last - size : last]
    return np.concatenate(found)
