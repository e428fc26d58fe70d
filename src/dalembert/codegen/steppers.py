"""Compiled steps of explicit methods, and events along them, for the loops that call them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, final

from ..lanes.workspace import EventKernels, no_events
from ..methods.pairs import PAIRS
from ..methods.step_constants import SMALLEST_SCALE
from ..once import BoundedTable, computed_once
from ..subset.addresses import NO_CODE, OwnedAddress
from ..transforms.runge_kutta_parts import memory_size
from ..transforms.taylor import order_at, scale_floor
from .host_code import interpreted_code
from .library import KernelLibrary

if TYPE_CHECKING:
    from ..events.event_code import EventCode
    from ..methods.tableau import Tableau


_MOST_EVENTS = 64
"""Sets of events of which the compiled kernels are kept."""


class Stepper(NamedTuple):
    """A compiled step.

    Attributes
    ----------
    codes : tuple of OwnedAddress
        Addresses of the step, and of the kernel that precedes the first one (0 for none).
    memory : int
        Numbers that a step of a case keeps for the next one.
    degree : int
        Degree of the polynomial of a step.
    settings : list of float
        What the step reads, and last the tolerances, for projections.
    evaluations : (int, int)
        Evaluations of the rates, or of the series, before the first attempt and in each.
    """

    codes: tuple[OwnedAddress, OwnedAddress]
    memory: int
    degree: int
    settings: list[float]
    evaluations: tuple[int, int] = (0, 1)


@final
class Steppers:
    """Compiled steps of one program.

    Parameters
    ----------
    steps : KernelLibrary
    n : int
        Size of the state.
    """

    def __init__(self, steps: KernelLibrary, n: int) -> None:
        self._steps, self._n = steps, n
        self._events: BoundedTable[tuple[EventCode, str, tuple[int, int], int, int, bool], EventKernels]
        self._events = BoundedTable(_MOST_EVENTS)

    def projections(self, lanes: int) -> tuple[OwnedAddress, OwnedAddress]:
        """Return the addresses of the corrections of positions and of velocities, 0 where there are none."""
        return self._steps.kernel("project_position", lanes), self._steps.kernel("project_velocity", lanes)

    def stepper(
        self,
        method: str,
        tolerances: tuple[float, float],
        lanes: int,
        *,
        dense: bool,
        bounded: bool = False,
        watched: EventCode | None = None,
        order: int = 0,
    ) -> Stepper:
        """Return the step of a method at tolerances `rtol` and `atol`; Taylor steps have an order of these, or `order`.

        With `watched` a Taylor step writes the series of these events too. If `bounded`, the error of polynomials of
        Runge-Kutta steps counts, too.
        """
        rtol, atol = tolerances
        if method == "taylor":
            order, floor = order or order_at(rtol, atol), scale_floor(rtol, atol)
            if watched is None:
                step = self._steps.taylor(order, lanes, dense=dense)
            else:
                step = self._steps.with_event_series(watched.watch.joint, len(watched.events), order, lanes)
            return Stepper((step, NO_CODE), 0, order, [floor, rtol, atol])
        tableau = pair_named(method, bounded=bounded)
        codes, memory = self._steps.attempt(tableau, lanes, dense=dense), memory_size(self._n, self._steps.carried)
        evaluations = 2, tableau.n_total - self._steps.carried
        settings = [rtol, max(atol, SMALLEST_SCALE), rtol, atol]
        return Stepper(codes, memory, tableau.degree, settings, evaluations)

    def events(
        self,
        code: EventCode | None,
        method: str,
        stepper: Stepper,
        lanes: int,
        with_series: int,
        *,
        tested: bool = True,
    ) -> EventKernels:
        """Return compiled events along the steps of a method.

        So many of them have series that the steps write: all or none. Where whole steps are not `tested`, all are
        searched.
        """
        if code is None:
            return no_events()
        shape = stepper.degree, stepper.memory

        def make() -> EventKernels:
            from .event_kernels import event_kernels

            refill = stepper.codes[1]
            if refill and lanes != 1:
                refill = self._steps.beginning(pair_named(method), 1)
            # in single runs kernels are interpreted where compiling them takes longer than running
            compiled = self._steps.extra_kernel if tested or self._steps.compiles_starts else interpreted_code
            about = compiled, self.projections(1), code, refill, (self._n, *shape)
            return event_kernels(*about, lanes, with_series, tested=tested, exact=not refill)

        return computed_once(self._events, (code, method, shape, lanes, with_series, tested), make)


def pair_named(name: str, *, bounded: bool = False) -> Tableau:
    """Return a Runge-Kutta pair by its name, whose tableau is imported here."""
    pair = PAIRS[name].tableau
    if not bounded:
        return pair
    from ..methods import tableaus

    return tableaus.bounded(pair)
