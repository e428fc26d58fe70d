"""Checks of runs for singular coordinates: angles that lock, and positions that come to their end.

Runs that meet the singularity of three angles end there, and say which angle has which value. Where constraints or
other bodies make the motion regular at such an attitude, there is no warning: what counts is whether the mass matrix on
the directions that the constraints leave free is singular there.

The cases of a sweep are known by a sign that changed between their start and their end. Where positions or constraints
have a kink at such an attitude, a motion may pass it twice: such cases are watched as they run.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, final

import numpy as np

from ..arrays import FloatArray
from ..errors import OptionError, list_names
from ..frozen import frozen
from ..ir.interpret import interpret_rows, mass_matrices
from ..ir.program import Program
from ..lanes.cases import BlockResult, CaseBlock
from ..methods.status import SUSPECT, Status
from ..reduction.margins import ROOT_END, Ends, Gimbals, gimbals, position_ends
from ..scene.orientation import with_quaternions
from ..scene.scene import Scene
from ..starts.constraint_rows import row_lengths
from ..starts.state_sizes import distance_sizes
from ..steps.problem import IntegrationProblem, Solution
from ..stops.segments import Constants, constants_at
from .run_check import FAILED, EndedRun, RunCheck, end_suspects
from .singular import cut

if TYPE_CHECKING:
    from ..model.model import CompiledModel

_NEAR = 0.05
"""Determinant below which a run that failed is taken to have failed for it."""

_NOTHING, _DEPENDENT = 1e-12, 1e-9
"""Determinant that counts as zero, and share of a constraint below which it follows from others."""


@final
@frozen(eq=False)
class GimbalCheck(RunCheck):
    """The angles of a model that may lock."""

    model: CompiledModel
    found: Gimbals

    @classmethod
    def of(cls, model: CompiledModel) -> GimbalCheck | None:
        """Return the check of a model; None where no angles can lock."""
        found = gimbals(model.stages.reduced)
        return None if found is None else cls(model, found)

    @property
    def program(self) -> Program:
        """The program of the model."""
        return self.model.stages.program

    def after(self, run: EndedRun) -> tuple[Solution, str]:
        """See `RunCheck.after`: a run ends before the first attitude at which its angles are singular."""
        solution, steps, c = run.solution, run.steps, run.constants
        if len(steps.t) == 0:
            return solution, ""
        failed = steps.status in FAILED
        values = interpret_rows(self.found.kernel, steps.t, steps.y, constants_at(c, steps.t))
        place, group = _first(values, failed=failed)
        if place < 0:
            return solution, ""
        where, value = (float(steps.t[place]), steps.y[place]), float(values[place, group])
        if not _singular(self.program, self.found, group, where, c, value):
            return solution, ""
        ended = replace(solution, status=Status.SINGULAR_COORDINATES)
        if not (failed and place == len(steps.t) - 1):
            where = _located(self.found, group, steps, place, values, c), steps.y[place]
            ended = cut(solution, where[0], run.span, Status.SINGULAR_COORDINATES)
        return ended, f"{_where(self.program, self.found, group, where, c, value)}; {_remedy(self.model.stages.scene)}"

    def locking(self, t: float, y: FloatArray, c: FloatArray) -> list[int]:
        """Return the groups of angles at whose lock motions next to a state y (n_y,) are singular, or may be."""
        values = interpret_rows(self.found.kernel, np.array([t]), y[np.newaxis], c)[0]
        where = t, y
        return [
            group
            for group, value in enumerate(values.tolist())
            if not self.found.decisive[group] or _singular(self.program, self.found, group, where, c, value)
        ]

    def guards(self, method: str) -> str:
        """See `RunCheck.guards`: for kinks where angles lock."""
        return "locks" if self.model.stages.reduced.equations.kinked_locks else ""

    def after_cases(self, method: str, block: CaseBlock, done: BlockResult) -> None:
        """See `RunCheck.after_cases`: the angles of a case locked by a sign that changed, or an end near zero.

        Cases that came near a kink run alone once more.
        """
        if self.model.engine.keeps_signs(self.found.kernel, block, done):
            return
        status = done.ends[:, 1]
        if self.guards(method):
            end_suspects(self, self.model, method, block, done, Status.SINGULAR_COORDINATES)
        first = interpret_rows(self.found.kernel, block.spans[:, 0], block.y, block.c)
        last = interpret_rows(self.found.kernel, done.ends[:, 0], done.y, block.c)
        ran = np.isin(status, (Status.SUCCESS, Status.EVENT))
        with np.errstate(invalid="ignore"):
            turned = np.any(first * last < 0.0, axis=1) & ran
            stopped = np.any(np.abs(last) < _NEAR, axis=1) & np.isin(status, FAILED)
        met = np.flatnonzero(turned | stopped)
        if not len(met):
            return
        i = int(met[0])  # what is singular in one case is so in all
        group = int(np.argmin(first[i] * last[i])) if turned[i] else int(np.nanargmin(np.abs(last[i])))
        c, where = block.c[i if len(block.c) > 1 else 0], (float(done.ends[i, 0]), done.y[i])
        if _singular(self.program, self.found, group, where, c, float(last[i, group])):
            status[met] = float(Status.SINGULAR_COORDINATES)


def _located(found: Gimbals, group: int, steps: Solution, place: int, values: FloatArray, c: Constants) -> float:
    """Return when a determinant vanishes before a step's end: by continuous output, else on a straight line."""
    low, high = float(steps.t[place - 1]), float(steps.t[place])
    before, after = abs(float(values[place - 1, group])), abs(float(values[place, group]))
    if steps.dense is None or before == 0.0 or after == 0.0:
        return low + (high - low) * (before / (before + after) if before + after else 0.0)
    sign = np.sign(values[place - 1, group])
    for _ in range(50):
        t = np.array([0.5 * (low + high)])
        if interpret_rows(found.kernel, t, steps.dense(t), constants_at(c, t))[0, group] * sign > 0.0:
            low = float(t[0])
        else:
            high = float(t[0])
    return high


def _first(values: FloatArray, *, failed: bool) -> tuple[int, int]:
    """Return the place after the first change of sign, or the end of a run that failed near zero; -1 for none."""
    if not len(values):
        return -1, 0
    if not failed and (values.min() > _NOTHING or values.max() < -_NOTHING):
        return -1, 0  # most runs, in a fraction of the time
    signs = np.where(np.abs(values) < _NOTHING, 0.0, np.sign(values))
    for place in range(1, len(values)) if np.any(signs != signs[0]) else ():
        for group in range(values.shape[1]):
            if signs[place, group] != signs[place - 1, group] and np.isfinite(values[place, group]):
                return place, group
    if failed:
        group = int(np.nanargmin(np.abs(values[-1]))) if np.any(np.isfinite(values[-1])) else 0
        if abs(values[-1, group]) < _NEAR:
            return len(values) - 1, group
    return -1, 0


def _singular(
    program: Program, found: Gimbals, group: int, where: tuple[float, FloatArray], c: Constants, value: float
) -> bool:
    """Return whether the mass matrix on the free directions is singular where the angle next to a state locks."""
    layout, times = program.layout, np.array([where[0]])
    n = len(layout.coordinates)
    c = constants_at(c, times)
    x = interpret_rows(program.kernel("expand"), times, where[1][np.newaxis], c)
    x[:, n : 2 * n] = 0.0
    if found.decisive[group]:
        place = layout.coordinates.index(found.decisive[group])
        x[0, place] = _lock(float(x[0, place]), value)
        value = 0.0
    mass = mass_matrices(program, times, x, c)[0]
    free = np.eye(n)
    if layout.constraints:
        rows = interpret_rows(program.kernel("constraint_jacobian"), times, x, c).reshape(-1, n)
        if not np.all(np.isfinite(rows)):
            return True
        sizes = distance_sizes(program, where[0], x[0], c if c.ndim == 1 else c[0])
        lengths = row_lengths(program, times, x, c, range(len(rows)))[0]
        _, shares, directions = np.linalg.svd(rows * sizes / lengths[:, np.newaxis])
        free = directions[int(np.sum(shares > _DEPENDENT)) :] * sizes
    if not np.all(np.isfinite(mass)) or not len(free):
        return len(free) > 0
    scale = np.sqrt(np.maximum(np.diag(mass), 1e-300))
    free = np.linalg.qr((free * scale).T)[0].T
    inner = (free / scale) @ mass @ (free / scale).T
    return bool(np.linalg.eigvalsh(inner)[0] <= 4.0 * value * value + 1e-10)


def _lock(angle: float, value: float) -> float:
    """Return the angle next to one at which its determinant, the sine or cosine of it up to its sign, vanishes."""
    half = 0.0 if abs(abs(math.sin(angle)) - abs(value)) < abs(abs(math.cos(angle)) - abs(value)) else 0.5
    return math.pi * (round(angle / math.pi - half) + half)


def _where(
    program: Program, found: Gimbals, group: int, where: tuple[float, FloatArray], c: Constants, value: float
) -> str:
    """Return which angle has which value, and when."""
    layout, (t, y) = program.layout, where
    times = np.array([t])
    x = interpret_rows(program.kernel("expand"), times, y[np.newaxis], constants_at(c, times))[0]
    listed = [found.decisive[group]] if found.decisive[group] else list(found.angles[group])
    angles = {name: float(x[layout.coordinates.index(name)]) for name in listed}
    if found.decisive[group]:
        angles = {name: _lock(angle, value) for name, angle in angles.items()}
    places = ", ".join(f"{name} = {_angle(angle)}" for name, angle in angles.items())
    others = [name for name in found.angles[group] if name not in listed]
    turned = f", where {list_names(others)} turn the body about the same line" if others else ""
    return f"gimbal lock at t = {t:.6g}: {places}{turned}"


def _angle(value: float) -> str:
    """Return an angle as a multiple of pi/2 where it is near one."""
    quarters = round(value / (math.pi / 2))
    if abs(value - quarters * math.pi / 2) > _NEAR:
        return f"{value:.6g}"
    if quarters % 2 == 0:
        return {0: "0", 1: "pi", -1: "-pi"}.get(quarters // 2, f"{quarters // 2} pi")
    return {1: "pi/2", -1: "-pi/2"}.get(quarters, f"{quarters} pi/2")


def _remedy(scene: Scene) -> str:
    """Return the remedy for angles that lock in a scene."""
    try:
        with_quaternions(scene)
    except OptionError:
        return "declare the attitude with dalembert.free_orientation, or choose angles that are regular there"
    return 'compile_model(scene, orientation="quaternion") passes it'


# Runs that come to the end of what positions are defined for (`dalembert.reduction.margins`).


@final
@frozen(eq=False)
class EndCheck(RunCheck):
    """Where the positions and constraints of a model end."""

    model: CompiledModel
    ends: Ends

    @classmethod
    def of(cls, model: CompiledModel) -> EndCheck | None:
        """Return the check of a model; None where nothing ends, and for the modes of contacts."""
        ends = None if model.stages.mode is not None else position_ends(model.stages.reduced)
        return None if ends is None else cls(model, ends)

    def before(self, problem: IntegrationProblem) -> IntegrationProblem:
        """See `RunCheck.before`: all steps are looked at, whatever is recorded."""
        return problem if problem.t_eval is None else replace(problem, dense=True)

    def after(self, run: EndedRun) -> tuple[Solution, str]:
        """See `RunCheck.after`: also of runs that failed later."""
        solution, steps = run.solution, run.steps
        if not len(steps.t):
            return solution, ""
        values = interpret_rows(self.ends.kernel, steps.t, steps.y, constants_at(run.constants, steps.t))
        arguments, sizes = np.hsplit(values, 2)
        shares = np.full(arguments.shape[1], max(ROOT_END, run.problem.rtol))
        shares[: self.ends.roots] = ROOT_END
        largest = np.maximum.accumulate(np.nan_to_num(sizes, nan=0.0), axis=0)
        ended = np.flatnonzero(~np.all(arguments > shares * largest, axis=1))  # or not a number
        if not len(ended):
            return solution, ""
        t = float(steps.t[ended[0]])
        note = (
            f"at t = {t:.6g} the positions or constraints came to the end of what they are defined for, where the"
            " coordinates are singular: take coordinates that are regular there, as an angle in place of"
            " sqrt(L**2 - x**2)"
        )
        return cut(solution, t, run.span, Status.NON_FINITE), note

    def guards(self, method: str) -> str:
        """See `RunCheck.guards`."""
        return "ends"

    def after_cases(self, method: str, block: CaseBlock, done: BlockResult) -> None:
        """See `RunCheck.after_cases`: cases that came to an end run alone once more.

        Others have passed it within a step, where what they are watched for has no value.
        """
        end_suspects(self, self.model, method, block, done, Status.NON_FINITE)
        if block.watch is not None and not block.watch.reported:
            lost = np.isin(done.ends[:, 1], (Status.EVENT_NON_FINITE, SUSPECT - Status.EVENT_NON_FINITE))
            done.ends[lost, 1] = float(Status.NON_FINITE)
