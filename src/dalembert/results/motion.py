"""Base class of simulated motions."""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import EnergyWarning, MissingExtraError, OptionError, nesting_named
from ..ir.program import Layout, Program
from ..methods.status import Status
from ..values import flag, option
from .estimate import Estimated
from .labels import attributes, value_name, with_units
from .notebook import ranges, summary

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

    from ..integrators.segments import Constants
    from ..scene import Scene
    from .animation import Animation
    from .events import EventRecords

__all__ = ["ENERGIES", "Motion", "RunStatistics", "reaction_hint", "warn_of_energy", "xarray_package"]

ENERGIES = ("energy", "kinetic_energy", "potential_energy")


def warn_of_energy(program: Program, name: str) -> None:
    """Warn that a requested energy lacks the potential of some loads."""
    if program.energy_note and name != "kinetic_energy":
        warnings.warn(program.energy_note, EnergyWarning, stacklevel=3)


@final
@dataclass(frozen=True)
class RunStatistics:
    """Cost of a run: accepted and rejected steps, evaluations of the right-hand side, seconds.

    `note` says why "auto" took another method than it usually does, or where a run met a singular configuration; `rtol`
    and `atol` are the tolerances, NaN where they are not known.
    """

    method: str
    steps: int
    rejected: int
    evaluations: int
    compile_seconds: float
    run_seconds: float
    note: str = ""
    rtol: float = math.nan
    atol: float = math.nan


class Motion(Estimated):
    """A motion at recorded times, by name.

    Attributes
    ----------
    t : ndarray (n_t,)
        Recorded times [s].
    elapsed : ndarray (n_t,)
        The same in the time of the model that ran: since the start of the run, where it is counted so.
    y : ndarray (n_t, n)
        State.
    q, qdot : ndarray (n_t, n_q)
        Coordinates and their rates.
    status : Status
        How the run ended.
    t_end : float
        Time that the run reached [s], recorded or not.
    stats : RunStatistics
        Cost of the run.
    events : EventRecords
        The events of the run, by name.
    """

    t: FloatArray
    elapsed: FloatArray
    y: FloatArray
    q: FloatArray
    qdot: FloatArray
    status: Status
    stats: RunStatistics
    events: EventRecords
    _layout: Layout
    _begin: float | None = None

    @abstractmethod
    def __call__(self, t: Any) -> Motion:
        """Return the motion at other times."""

    @property
    @abstractmethod
    def can_evaluate(self) -> bool:
        """Whether the run can be evaluated between the recorded times."""

    @abstractmethod
    def rows(self, some: NDArray[np.intp]) -> Motion:
        """Return the motion at some of the recorded times, by number (k,)."""

    @property
    @abstractmethod
    def _pictured(self) -> tuple[Scene, Constants] | None:
        """The scene, and constants that begin with its parameters; None where the motion does not have them."""

    def counted_from(self, start: float, t: FloatArray | None = None, note: str | None = None) -> Self:
        """Return this motion with its times, which are counted from its start, counted as `start` is.

        Parameters
        ----------
        start : float
            Time of the start [s].
        t : ndarray (k,), optional
            The requested times [s], of which the run reached the first ``len(elapsed)``; they are recorded without
            rounding.
        note : str, optional
            Note of the statistics, in place of the present one.
        """
        self._begin = start
        self.t = start + self.elapsed if t is None else t[: len(self.elapsed)].copy()
        self.events.counted_from(start)
        if note is not None:
            self.stats = replace(self.stats, note=note)
        return self

    def _dataset(
        self, scene: str, data: Mapping[str, Any], parameters: Mapping[str, float], units: Mapping[Any, str] | None
    ) -> xarray.Dataset:
        """Return arrays by name over ``time``, with the attributes of the run and units."""
        formulation = ", ".join(self._formulations)
        attrs = {"status": self.status.name, **attributes(scene, formulation, self.stats, parameters)}
        times = {"time": ("time", self.t, {"units": "s"})}
        named: dict[str, Any] = {}
        for name, values in data.items():
            named[value_name(name, named)] = values
        dataset: xarray.Dataset = xarray_package().Dataset(named, coords=times, attrs=attrs)
        return with_units(dataset, units, self._layout.aliases, parameters)

    @property
    @abstractmethod
    def t_end(self) -> float:
        """Time that the run reached [s]."""

    @property
    @abstractmethod
    def _formulations(self) -> tuple[str, ...]:
        """The formulations that the run was made in."""

    @property
    def success(self) -> bool:
        """Whether the end of the span, or a terminal event, was reached."""
        return self.status.success

    @property
    def message(self) -> str:
        """The status of the run, as a sentence."""
        note, said = self.stats.note, self.status.message_for(self._formulations, self.stats.method)
        return f"{said} Note: {note}." if note else said

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return self._layout.coordinates

    @nesting_named
    def plot(self, *names: Any, ax: Any = None) -> Figure:
        """Draw the motion over time, one panel a name (coordinates by default), and return the figure.

        The figure is one of pyplot, which ``plt.show()`` shows.

        Parameters
        ----------
        *names : str or symbol
        ax : matplotlib.axes.Axes or sequence of Axes, optional
            Where to draw: all names on one, with a legend, or each on its own.

        Raises
        ------
        MissingExtraError
            Without matplotlib.
        OptionError
            For as many axes as there are no names.
        """
        from .plots import plot

        return plot(self, [str(name) for name in names] or list(self.coordinates), ax)

    def _repr_html_(self) -> str:
        facts = [("status", f"{self.status.name}. {self.message}")]
        if len(self.t):
            facts.append(("time", f"{self.t[0]:g} to {self.t[-1]:g} s, {len(self.t)} times"))
        facts.append(("method", f"{self.stats.method}, {self.stats.steps} steps, {self.stats.rejected} rejected"))
        names = dict.fromkeys((*self._layout.variables, *self._layout.outputs))
        rows = ranges(names, (self[name] for name in names)) if len(self.t) else []
        return summary(repr(self)[1:-1], facts, ("name", "least", "largest", "last"), rows)

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.names)

    @property
    @abstractmethod
    def variables(self) -> FloatArray:
        """Coordinates, rates and first-order states (n_t, 2 n_q + n_z)."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """All names that ``self[name]`` takes."""

    @nesting_named
    def animate(
        self, *, fps: float = 25.0, speed: float = 1.0, points: Sequence[Any] = (), reactions: bool = False
    ) -> Animation:
        """Return a moving picture of the bodies: their shapes (`Scene.add_shapes`), paths, links and points.

        Bodies without a shape are drawn by their mass centre, their axes, and lines to the points of joints. A motion
        in a plane is drawn in it, any other in space. A notebook shows the animation. Its ``save`` writes it to a file:
        ``save("motion.html")`` makes one page that opens without a network, with controls to play, to choose a time and
        to turn.

        Parameters
        ----------
        fps : float
            Pictures a second.
        speed : float
            Seconds of the motion that pass in one second of the picture.
        points : sequence of Point or str
            Further points to draw.
        reactions : bool
            Whether to draw the forces of joints as lines from their points, the largest a third of the picture long.
            Their components must be among the outputs of the model.

        Raises
        ------
        MissingExtraError
            Without matplotlib.
        OptionError
            For points that are not known, options that are not positive, shapes of bodies that do not exist, reactions
            that are no outputs, and scenes that have no positions.
        """
        try:
            from .animation import animate
        except ImportError:
            raise MissingExtraError('matplotlib is needed; install it with: pip install "dalembert[plot]"') from None
        if self._pictured is None:
            raise OptionError("this motion has no scene; use one that simulate returned")
        scene, constants = self._pictured
        return animate(
            self, scene, constants, points, option("fps", fps), option("speed", speed), flag("reactions", reactions)
        )


def reaction_hint(layout: Layout, name: str) -> str:
    """Return the advice to request a reaction as an output; empty for other names."""
    if name not in layout.unknowns:
        return ""
    return f" It is a reaction of the scene; request it with compile_model(scene, outputs=[{name!r}])."


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
