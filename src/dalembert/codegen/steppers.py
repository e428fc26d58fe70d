"""Compiled steps of explicit methods, and events along them, for the loops that call them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, final

import numpy as np

from ..arrays import FloatArray
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..lanes.row_steps import ImplicitSteps
from ..lanes.workspace import POINT_LANES, SLOPE_LANES, EventKernels, no_events
from ..methods.names import PAIRS
from ..methods.step_constants import SMALLEST_SCALE
from ..once import BoundedTable, computed_once
from ..options import component_tolerances
from ..steps.recorded_runs import RunCodes
from ..subset.arguments import NO_CODE, AddressTable, OwnedAddress
from ..transforms.runge_kutta_parts import CONTROLS, memory_size
from ..transforms.taylor.step import order_at, scale_floor
from .host_code import interpreted_code
from .library import KernelLibrary

if TYPE_CHECKING:
    from ..events.event_code import EventCode
    from ..methods.tableau import Tableau


def event_kernels(
    compiled: Callable[[Kernel, int], OwnedAddress],
    projections: tuple[OwnedAddress, OwnedAddress],
    code: EventCode,
    refill: OwnedAddress,
    sizes: tuple[int, int, int],
    lanes: int,
    with_series: int,
    *,
    tested: bool,
    exact: bool,
) -> EventKernels:
    """Return compiled kernels of events and reductions.

    Parameters
    ----------
    compiled : function
        Compiles a kernel for lanes.
    projections : (OwnedAddress, OwnedAddress)
        Corrections of positions and of velocities, for one lane.
    code : EventCode
    refill : OwnedAddress
        What a step remembers at its start; `NO_CODE` for Taylor steps.
    sizes : (int, int, int)
        Of the state, the degree of the polynomials of a step, and the memory of a step.
    lanes : int
    with_series : int
        Number of events of which the steps write series: all or none.
    tested : bool
        Whether there is a test of whole steps; else all steps are searched.
    exact : bool
        Whether polynomials of steps have no error that counts.
    """
    from ..events.reductions import KINDS
    from ..transforms import step_bounds, step_polynomials

    values, slopes = code.watch.values, code.watch.slopes
    jumps = [NO_CODE if jump is None else compiled(jump, 1) for jump in code.jumps]
    n, degree, memory = sizes
    step = step_polynomials.StepShape(degree, n + with_series, n + with_series + 2 + memory, in_time=memory == 0)
    signs, running, bounds, at_points = NO_CODE, code.running, NO_CODE, dict[str, Kernel]()
    if tested and with_series:
        signs = compiled(step_bounds.series_signs_kernel(with_series, n + with_series, degree), lanes)
    elif tested and step_polynomials.are_polynomials(values, step):
        signs = compiled(step_bounds.polynomial_signs_kernel(values, step), lanes)
    elif tested:
        at_points["step_values"] = values
        signs = compiled(step_bounds.point_signs_kernel(len(values.outputs), code.oscillating), lanes)
    if code.kinds and step_polynomials.are_polynomials(running, step):
        bounds = compiled(step_bounds.polynomial_bounds_kernel(running, step, code.kinds), lanes)
    elif code.kinds:
        at_points["step_running"] = running
        bounds = compiled(step_bounds.point_bounds_kernel(code.kinds, code.running_oscillates), lanes)
    points = {name: compiled(kernel, lanes) for name, kernel in at_points.items()}
    if at_points:
        components = set().union(*map(step_polynomials.components_of, at_points.values()))
        points["step_points"] = compiled(step_polynomials.step_points_kernel(components, step, n), lanes)
    return EventKernels(
        step_signs=signs,
        values=compiled(values, POINT_LANES),
        value=compiled(values, 1),
        begins=compiled(code.watch.begins, 1),
        slopes=NO_CODE if slopes is None else compiled(slopes.kernel, SLOPE_LANES),
        varying=np.array([] if slopes is None else slopes.varying, np.int64),
        residuals=0 if slopes is None else slopes.residuals,
        start=compiled(code.start.kernel, 1) if any(jump is not None for jump in code.jumps) else NO_CODE,
        refill=refill,
        given=len(code.start.given),
        checks=2 * len(code.start.labels),
        jumps=AddressTable(jumps),
        directions=np.array([event.direction for event in code.events], np.int64),
        last=np.array([int(event.terminal) for event in code.events], np.int64),
        used=np.array(sorted(step_polynomials.components_of(values)), np.int64),
        step_bounds=bounds,
        held=compiled(step_bounds.held_kernel(len(code.events), code.kinds), lanes) if tested else NO_CODE,
        running=compiled(running, POINT_LANES) if code.kinds else NO_CODE,
        at=compiled(running, 1) if code.kinds else NO_CODE,
        kinds=np.array([KINDS.index(kind) for kind in code.kinds], np.int64),
        read=np.array(sorted(step_polynomials.components_of(running)), np.int64),
        events_with_series=with_series,
        oscillating=int(code.oscillating),
        running_oscillates=int(code.running_oscillates),
        position=projections[0],
        velocity=projections[1],
        exact=int(exact),
        **points,
    )


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
    weighted : bool
        Whether each component of the state has an absolute tolerance of its own.
    rows : ImplicitSteps or None
        Steps on rows, which need a lane of their own, in place of `codes`.
    allowed : ndarray (n_y,)
        Absolute tolerances of the components of the state, for these.
    """

    codes: tuple[OwnedAddress, OwnedAddress]
    memory: int
    degree: int
    settings: list[float]
    evaluations: tuple[int, int] = (0, 1)
    weighted: bool = False
    rows: ImplicitSteps | None = None
    allowed: FloatArray = np.empty(0)


@final
class Steppers:
    """Compiled steps of one program.

    Parameters
    ----------
    steps : KernelLibrary
    program : Program
    """

    def __init__(self, steps: KernelLibrary, program: Program) -> None:
        self._steps, self._program, self._names = steps, program, program.layout.state
        self._n = len(self._names)
        self._events: BoundedTable[tuple[EventCode, str, tuple[int, int], int, int, bool, bool], EventKernels]
        self._events = BoundedTable(_MOST_EVENTS)
        self._implicit: dict[int, ImplicitSteps] = {}

    def projections(self, lanes: int) -> tuple[OwnedAddress, OwnedAddress]:
        """Return the addresses of the corrections of positions and of velocities, 0 where there are none."""
        return self._steps.kernel("project_position", lanes), self._steps.kernel("project_velocity", lanes)

    @property
    def explicit(self) -> RunCodes:
        """Kernels of steps of Runge-Kutta pairs that are not compiled."""
        return self._codes(1)

    def _codes(self, lanes: int) -> RunCodes:
        kernel = self._steps.kernel
        return RunCodes(kernel("rhs", lanes), *self.projections(lanes), kernel("knots", lanes))

    def implicit(self, lanes: int = 1) -> ImplicitSteps:
        """Return steps of the implicit method, of so many cases side by side."""
        return computed_once(self._implicit, lanes, lambda: self._implicit_steps(lanes))

    def _implicit_steps(self, lanes: int) -> ImplicitSteps:
        from ..steps.implicit_loop import DEGREE

        steps, program = self._steps, self._program
        if "stages" not in program:
            jacobian, tangent = steps.derivative("rhs", lanes)
            codes = self._codes(lanes)._replace(jacobian=jacobian, tangent=tangent)
            return ImplicitSteps(codes, self._n, 0, 0, DEGREE)
        jacobian, tangent = steps.derivative("stages", lanes)
        kernel = program.kernel("multipliers")
        multipliers = steps.kernel(kernel.name, lanes) if steps.compiles_starts else interpreted_code(kernel, lanes)
        codes = RunCodes(
            steps.kernel("stages", lanes),
            knots=steps.kernel("knots", lanes),
            jacobian=jacobian,
            tangent=tangent,
            multipliers=multipliers,
        )
        return ImplicitSteps(codes, self._n, len(kernel.outputs), len(program.layout.states), DEGREE)

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
        own = component_tolerances(atol, self._names)
        weighted, atol = own is not None, float(atol)
        if method == "radau":
            steps, each = self.implicit(lanes), np.full(self._n, atol) if own is None else own
            return Stepper((NO_CODE, NO_CODE), CONTROLS, steps.degree, [rtol, atol], rows=steps, allowed=each)
        if method == "taylor":
            order, floor = order or order_at(rtol, atol), scale_floor(rtol, atol)
            if watched is None:
                step = self._steps.taylor(order, lanes, dense=dense, weighted=weighted)
            else:
                about = watched.watch.joint, len(watched.events), order, lanes
                step = self._steps.with_event_series(*about, weighted=weighted)
            weights = [] if own is None else (atol / own).tolist()
            return Stepper((step, NO_CODE), 0, order, [floor, *weights, rtol, atol], weighted=weighted)
        tableau = pair_named(method, bounded=bounded)
        codes = self._steps.attempt(tableau, lanes, dense=dense, weighted=weighted)
        evaluations = 2, tableau.n_total - self._steps.carried
        allowed = [max(a, SMALLEST_SCALE) for a in ([atol] if own is None else own.tolist())]
        settings, memory = [rtol, *allowed, rtol, atol], memory_size(self._n, self._steps.carried)
        return Stepper(codes, memory, tableau.degree, settings, evaluations, weighted)

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

            refill = stepper.codes[1]
            if refill and lanes != 1:
                refill = self._steps.beginning(pair_named(method), 1, weighted=stepper.weighted)
            # in single runs kernels are interpreted where compiling them takes longer than running
            compiled = self._steps.extra_kernel if tested or self._steps.compiles_starts else interpreted_code
            about = compiled, self.projections(1), code, refill, (self._n, *shape)
            return event_kernels(*about, lanes, with_series, tested=tested, exact=not stepper.memory)

        return computed_once(self._events, (code, method, shape, lanes, with_series, tested, stepper.weighted), make)


def pair_named(name: str, *, bounded: bool = False) -> Tableau:
    """Return a Runge-Kutta pair by its name, whose tableau is imported here."""
    pair = PAIRS[name].tableau
    if not bounded:
        return pair
    from ..methods import tableaus

    return tableaus.bounded(pair)
