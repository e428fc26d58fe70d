"""Batches: many cases of one problem, and exact states at the end of the first of them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from cases import DOUBLE, END, PROBLEMS, UNEQUAL, Problem, sphere_rhs, unequal_parameters
from exact import spatial_angular_velocity
from extended import FILE
from numpy.typing import NDArray

from oracles.sleigh_exact import sleigh_state
from oracles.sphere_exact import sphere_state

__all__ = ["BATCHES", "SAMPLE", "Batch", "references", "sample_states"]

FloatArray = NDArray[np.float64]
SAMPLE = 8
"""Cases whose error is known: the first ones."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Many cases of one problem.

    Attributes
    ----------
    problem : Problem
    initial, parameters : mapping of str to float or ndarray (k,)
        As `dalembert` takes them.
    y, p : ndarray (k, n_y), (k, n_p)
        Start and parameters of the equations reduced by hand.
    """

    problem: Problem
    initial: Mapping[str, Any]
    parameters: Mapping[str, Any]
    y: FloatArray
    p: FloatArray

    def scene_state(self, i: int, y: FloatArray) -> FloatArray:
        """Return (q, q_dot) of case i from its state in the equations reduced by hand."""
        if self.problem.name in ("sleigh", "double pendulum"):
            return np.concatenate(self.problem.reduced.to_scene(y))
        return np.concatenate([y, self.problem.reduced.rhs(y.tolist(), self.p[i].tolist(), (math.sin, math.cos))])


def _sleighs(count: int) -> Batch:
    random = np.random.default_rng(0)
    b, v, omega = random.uniform((0.1, 0.5, -2), (0.5, 1.5, 2), (count, 3)).T
    inertia, theta = 0.25 + b**2, 0.2
    initial = {"x": 0.0, "y": 0.0, "theta": theta, "x_dot": v * math.cos(theta), "theta_dot": omega}
    still = np.zeros(count)
    y = np.stack([still, still, still + theta, v, omega], axis=1)
    return Batch(PROBLEMS["sleigh"], initial, {"m": 1.0, "b": b, "I_C": inertia}, y, np.stack([b, b / inertia], axis=1))


def _spheres(count: int) -> Batch:
    """Return spheres of radii and spins by chance, about one axis, so that theta keeps its distance from zero."""
    random, problem = np.random.default_rng(1), PROBLEMS["sphere"]
    radius, factor = random.uniform((0.4, 0.8), (0.6, 1.2), (count, 2)).T
    omega = factor[:, None] * np.array(problem.reduced.parameters[1:])
    y, p = np.tile(problem.reduced.start, (count, 1)), np.column_stack([radius, omega])
    rates = sphere_rhs(y.T, p.T, (np.sin, np.cos))
    names = ("x", "y", "psi", "theta", "phi")
    initial = {name: problem.initial[name] for name in names}
    initial |= {f"{name}_dot": rate for name, rate in zip(names, rates, strict=True)}
    return Batch(problem, initial, {**problem.parameters, "r": radius}, y, p)


def _unequal_spheres(count: int) -> Batch:
    random, problem = np.random.default_rng(1), PROBLEMS["unequal sphere"]
    factors = random.uniform(0.8, 1.2, (count, 3)).T  # drawn case by case, so that the first ones are always the same
    moments = {name: UNEQUAL[name] * factor for name, factor in zip("ABC", factors, strict=True)}
    q = problem.reduced.start
    qdot = np.array([problem.initial[f"{name}_dot"] for name in ("x", "y", "psi", "theta", "phi")])
    omega = spatial_angular_velocity(q, qdot)
    p = [
        unequal_parameters({**UNEQUAL, **{name: values[i] for name, values in moments.items()}}, q, omega)
        for i in range(count)
    ]
    return Batch(problem, problem.initial, {**UNEQUAL, **moments}, np.tile(q, (count, 1)), np.array(p))


def _double_pendula(count: int) -> Batch:
    random, problem = np.random.default_rng(2), PROBLEMS["double pendulum"]
    factors = random.uniform(0.8, 1.2, (count, 4)).T
    p = {name: DOUBLE[name] * factor for name, factor in zip(("m_1", "m_2", "l_1", "l_2"), factors, strict=True)}
    columns = [*p.values(), np.full(count, DOUBLE["g"])]
    return Batch(
        problem, problem.initial, {**DOUBLE, **p}, np.tile(problem.reduced.start, (count, 1)), np.stack(columns, axis=1)
    )


BATCHES: dict[str, Callable[[int], Batch]] = {
    "sleigh": _sleighs,
    "sphere": _spheres,
    "unequal sphere": _unequal_spheres,
    "double pendulum": _double_pendula,
}


def sample_states(batch: Batch, count: int = SAMPLE) -> FloatArray:
    """Return the exact (q, q_dot) at the end of the first cases."""
    rows = []
    for i in range(count):
        if batch.problem.name == "sleigh":
            x, y, theta, v, omega = batch.y[i].tolist()
            p = {name: float(np.broadcast_to(value, len(batch.y))[i]) for name, value in batch.parameters.items()}
            exact = sleigh_state(END, **p, x=x, y=y, theta=theta, v=v, omega=omega)
            rows.append(np.concatenate([exact.q, exact.qdot]))
        elif batch.problem.name == "sphere":
            r, *omega = batch.p[i].tolist()
            exact = sphere_state(END, r, *batch.y[i].tolist(), omega)
            rows.append(np.concatenate([exact.q, exact.qdot]))
        else:
            known = json.loads(FILE.read_text(encoding="utf-8"))[f"{batch.problem.name} {i}"]
            rows.append(batch.scene_state(i, np.array([float(value) for value in known])))
    return np.array(rows)


def references(count: int = SAMPLE) -> dict[str, tuple[Any, Any, Any]]:
    """Return what `extended` has to solve for the samples that have no closed form."""
    found: dict[str, tuple[Any, Any, Any]] = {}
    for build in (_unequal_spheres, _double_pendula):
        batch = build(count)
        for i in range(count):
            found[f"{batch.problem.name} {i}"] = batch.problem.reduced.rhs, batch.p[i].tolist(), batch.y[i].tolist()
    return found
