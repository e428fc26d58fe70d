"""Runs that meet the singularity of three angles: they end there, and say which angle has which value.

Where constraints or other bodies make the motion regular at such an attitude, nothing is said of it: what counts is
whether the mass matrix on the directions that the constraints leave free is singular there.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..codegen.base import FloatArray
from ..errors import OptionError, list_names
from ..integrators.problem import Solution
from ..integrators.status import Status
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..reduction.gimbal import Gimbals
from ..scene.orientation import with_quaternions
from ..scene.scene import Scene
from .singular import cut

__all__ = ["locked", "locks", "remedy"]

_NEAR = 0.05
"""Determinant below which a run that failed is taken to have failed for it."""

_NOTHING = 1e-12
_FAILED = (Status.STEP_TOO_SMALL, Status.NON_FINITE, Status.PROJECTION_FAILED, Status.MAX_STEPS)


def locked(
    program: Program, found: Gimbals, solution: Solution, c: FloatArray, steps: Solution
) -> tuple[Solution, str]:
    """Return a run ended before the first attitude at which its angles are singular, and where that was.

    `steps` is the same run with its accepted steps for records.
    """
    if len(steps.t) == 0:
        return solution, ""
    failed = steps.status in _FAILED
    values = interpret_rows(found.kernel, steps.t, steps.y, c)
    place, group = _first(values, failed=failed)
    if place < 0 or not _singular(program, steps.t[place], steps.y[place], c, float(values[place, group])):
        return solution, ""
    note = _where(program, found, group, float(steps.t[place]), steps.y[place], c)
    if failed and place == len(steps.t) - 1:
        return replace(solution, status=Status.SINGULAR_COORDINATES), note
    return cut(solution, float(steps.t[place]), Status.SINGULAR_COORDINATES), note


def locks(values: FloatArray, *, failed: bool) -> bool:
    """Return whether determinants along one run (k, n_group) change their sign, or a failed run ends near zero."""
    return _first(values, failed=failed)[0] >= 0


def _first(values: FloatArray, *, failed: bool) -> tuple[int, int]:
    """Return the place after the first change of sign, or the end of a run that failed near zero; -1 for none."""
    if not len(values):
        return -1, 0
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


def _singular(program: Program, t: float, y: FloatArray, c: FloatArray, value: float) -> bool:
    """Return whether the mass matrix on the free directions is about as small as the square of a determinant."""
    layout, times = program.layout, np.array([t])
    n = len(layout.coordinates)
    x = interpret_rows(program.kernel("expand"), times, y[np.newaxis], c)
    x[:, n:] = 0.0
    mass = interpret_rows(program.kernel("mass_matrix"), times, x, c).reshape(n, n)
    free = np.eye(n)
    if layout.constraints:
        rows = interpret_rows(program.kernel("constraint_jacobian"), times, x, c).reshape(-1, n)
        if not np.all(np.isfinite(rows)):
            return True
        _, sizes, directions = np.linalg.svd(rows)
        free = directions[int(np.sum(sizes > 1e-9 * sizes.max(initial=1.0))) :]
    if not np.all(np.isfinite(mass)) or not len(free):
        return len(free) > 0
    scale = np.sqrt(np.maximum(np.diag(mass), 1e-300))
    free = np.linalg.qr((free * scale).T)[0].T
    inner = (free / scale) @ mass @ (free / scale).T
    return bool(np.linalg.eigvalsh(inner)[0] <= 4.0 * value * value + 1e-10)


def _where(program: Program, found: Gimbals, group: int, t: float, y: FloatArray, c: FloatArray) -> str:
    """Return which angle has which value, and when."""
    layout = program.layout
    x = interpret_rows(program.kernel("expand"), np.array([t]), y[np.newaxis], c)[0]
    listed = [found.decisive[group]] if found.decisive[group] else list(found.angles[group])
    places = ", ".join(f"{name} = {_angle(float(x[layout.coordinates.index(name)]))}" for name in listed)
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


def remedy(scene: Scene) -> str:
    """Return what to do about angles that lock in a scene."""
    try:
        with_quaternions(scene)
    except OptionError:
        return "declare the attitude with dalembert.free_orientation, or choose angles that are regular there"
    return 'compile_model(scene, orientation="quaternion") passes it'
