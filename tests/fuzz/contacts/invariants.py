"""What every motion with contacts must obey, whatever the reference says: `violations` of a run.

Gaps, slip velocities, masses and forces are those of `systems`; the motion and its reactions are those of the run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any, final

import numpy as np
from scipy.optimize import linprog

from fuzz.contacts.impact_sequences import impacts_in_turn
from fuzz.contacts.moreau_jean import Array
from fuzz.contacts.scenes import Setting
from fuzz.contacts.systems import SYSTEMS, System, equations

__all__ = ["TOLERANCE", "Rows", "merged", "rows_at", "violations"]

NODES = 8
PIECE = 0.05
"""Longest piece [s] over which accelerations are integrated by Gauss' rule."""
HALVES = 100
"""How often pieces of a phase are halved, at most."""
NEAR = 1e-9
"""Distance [s] from a time at which forces jump, within which velocities may not change."""
TOLERANCE = 1e-5
"""Of states, velocities and forces, over their sizes in the run."""
SLIP_ERROR = 0.05
"""Error of a slip velocity, as a share of the tolerance, that the direction of friction may follow."""


@final
@dataclass(frozen=True, eq=False)
class Rows:
    """Of k contacts: M (n, n), f (n,), gaps, laws (k, 3), rows J (k, 3, n), drifts w (k, 3)."""

    system: System
    M: Array
    f: Array
    gap: Array
    law: Array
    J: Array
    w: Array

    def speeds(self, v: Array) -> Array:
        """Return normal and tangential velocities of the contacts (k, 3)."""
        return self.J @ v + self.w


def rows_at(name: str, t: float, q: Array, v: Array, p: Array) -> Rows:
    """Return the equations of a system at a state."""
    n, k = len(q), SYSTEMS[name].contacts
    whole = np.zeros((n, n)), np.zeros(n), np.zeros(k), np.zeros((k, 3)), np.zeros((k, 3, n)), np.zeros((k, 3))
    equations(name)(float(t), np.ascontiguousarray(q), np.ascontiguousarray(v), p, *whole)
    return Rows(SYSTEMS[name], *whole)


def merged(run: Any, brief: float = 0.0) -> list[tuple[str, ...]]:
    """Return what the contacts of a run do in turn; phases that do the same as the one before are one with it.

    Phases up to `brief` [s] are left out.
    """
    found: list[tuple[str, ...]] = []
    for phase in run.phases:
        modes = tuple(phase.modes.values())
        if phase.t1 - phase.t0 > brief and (not found or found[-1] != modes):
            found.append(modes)
    return found


def violations(
    setting: Setting,
    p: Array,
    run: Any,
    tolerance: float = TOLERANCE,
    breaks: Sequence[float] = (),
    kicks: Sequence[float] = (),
) -> list[str]:
    """Return what a run violates, each with a time and a size; none if it is right.

    Parameters
    ----------
    setting : Setting
        The scene.
    p : ndarray
        Numbers of its system.
    run : Trajectory
    tolerance : float
        Of states, velocities and forces, over their sizes.
    breaks : sequence of float
        Times within phases at which forces jump [s].
    kicks : sequence of float
        Times at which maps of users change the state [s].
    """
    checks = _Checks(setting, p, run, tolerance)
    checks.breaks, checks.kicks = np.array(breaks), np.array(kicks)
    return list(checks.everything())


@final
class _Checks:
    """The checks of one run."""

    def __init__(self, setting: Setting, p: Array, run: Any, tolerance: float) -> None:
        self.setting, self.p, self.run, self.tolerance = setting, p, run, tolerance
        self.size_q, self.size_v = max(0.1, np.max(np.abs(run.q))), max(0.1, np.max(np.abs(run.qdot)))
        nodes, _ = np.polynomial.legendre.leggauss(NODES)
        self.nodes, self.halves = nodes, HALVES
        self.breaks, self.kicks = np.empty(0), np.empty(0)
        basis = np.polynomial.legendre.legvander(nodes, NODES - 1)
        whole = [np.polynomial.legendre.legint(np.eye(NODES)[j]) for j in range(NODES)]
        integrals = np.column_stack([np.polynomial.legendre.legval(nodes, c) for c in whole]) @ np.linalg.inv(basis)
        self.integrals = integrals - integrals[0]  # from the first node to each

    def everything(self) -> Iterator[str]:
        """Yield all violations, the first of each kind in a phase."""
        for phase in self.run.phases:
            if phase.t1 - phase.t0 > 1e-7:
                seen: set[str] = set()
                for text in self.phase(phase):
                    kind = text.split(" = ")[0]
                    if kind not in seen:
                        seen.add(kind)
                        yield f"{text} in {tuple(phase.modes.values())} of {phase.t0:.6g} to {phase.t1:.6g}"
        yield from self.impacts()

    def phase(self, phase: Any) -> Iterator[str]:
        count = 1 + int((phase.t1 - phase.t0) / PIECE)
        inner = self.breaks[(self.breaks > phase.t0) & (self.breaks < phase.t1)]
        edges = np.union1d(np.linspace(phase.t0, phase.t1, count + 1), inner)
        for t in inner:
            before, after = self.run(np.array([t - NEAR, t + NEAR])).qdot
            if np.max(np.abs(after - before)) > self.tolerance * self.size_v:
                yield f"jump of velocities where forces jump = {after - before} at {t:.6g}"
        self.halves = HALVES
        for low, high in pairwise(edges):
            texts: list[str] = []
            error = self.unexplained(phase, low, high, texts) / self.size_v
            yield from texts
            if error > self.allowed(phase, low, high):
                yield f"velocity gained that forces do not explain = {error:.2e} at {low:.6g}"

    def allowed(self, phase: Any, low: float, high: float) -> float:
        """Return the error allowed of a piece: more where slip in a plane begins or turns at next to no speed.

        The direction of friction follows slip velocities up to their own errors: at a speed u it may be wrong by
        error / u, and by 2 at most.
        """
        if SYSTEMS[self.setting.system].directions < 2 or "slip" not in phase.modes.values():
            return self.tolerance
        near = np.geomspace(1e-6, 1e-2, 40)
        shares = np.concatenate([[0.0], near, np.linspace(1e-2, 1.0 - 1e-2, 200)[1:-1], 1.0 - near[::-1], [1.0]])
        motion = self.run(low + (high - low) * shares)
        wrong, pull = np.zeros(len(shares)), 0.0
        for i, (t, q, v) in enumerate(zip(motion.t, motion.q, motion.qdot, strict=True)):
            rows = rows_at(self.setting.system, t, q, v, self.p)
            speed = float(np.hypot(*rows.speeds(v)[0, 1:]))
            wrong[i] = min(2.0, SLIP_ERROR * self.tolerance * self.size_v / max(speed, 1e-300))
            normal = float(motion[self.setting.contacts[0].normal][i])
            pull = max(pull, rows.law[0, 0] * abs(normal) / float(np.min(np.diag(rows.M))))
        return self.tolerance + pull * float(np.trapezoid(wrong, motion.t)) / self.size_v

    def unexplained(self, phase: Any, low: float, high: float, texts: list[str]) -> float:
        """Return the change of velocity in a piece of a phase that its forces do not explain.

        A piece is halved where the rule may be at fault, as where slip in a plane turns sharply or ends; violations
        of laws at the nodes are added to `texts`.
        """
        times = 0.5 * (low + high) + 0.5 * (high - low) * self.nodes
        part = self.run(times)
        reactions = np.array([part[name] for name in self.setting.outputs]).T
        a = np.zeros_like(part.qdot)
        for i, t in enumerate(times):
            rows = rows_at(self.setting.system, t, part.q[i], part.qdot[i], self.p)
            P = self.reactions(reactions[i])
            if not np.all(np.isfinite(P)):
                texts.append(f"reactions = {reactions[i]} at {t:.6g}")
                return 0.0
            a[i] = np.linalg.solve(rows.M, rows.f + np.einsum("kjn,kj->n", rows.J, P))
            texts.extend(self.laws(t, phase, rows, part.qdot[i], P))
        gained = 0.5 * (high - low) * self.integrals @ a
        error = float(np.max(np.abs(part.qdot - part.qdot[0] - gained)))
        if error <= self.tolerance * self.size_v or self.halves == 0:
            return error
        self.halves -= 1
        halves = (low, 0.5 * (low + high)), (0.5 * (low + high), high)
        return sum(self.unexplained(phase, *half, texts) for half in halves)

    def reactions(self, values: Array) -> Array:
        """Return reactions (k, 3) of those of the outputs."""
        P, place = np.zeros((len(self.setting.contacts), 3)), 0
        for k, contact in enumerate(self.setting.contacts):
            count = 1 + len(contact.tangential)
            P[k, :count] = values[place : place + count]
            place += count
        return P

    def laws(self, t: float, phase: Any, rows: Rows, v: Array, P: Array) -> Iterator[str]:
        u, modes = rows.speeds(v), [phase.modes[contact.name] for contact in self.setting.contacts]
        force = 1e-3 * np.max(np.diag(rows.M)) + np.max(np.abs(rows.f)) + np.max(np.abs(P))
        small = self.tolerance * force
        for k, mode in enumerate(modes):
            name = self.setting.contacts[k].name
            if not rows.system.bilateral and rows.gap[k] < -self.tolerance * self.size_q:
                yield f"{name}: gap = {rows.gap[k]:.2e} at {t:.6g}"
            if mode == "open":
                if np.max(np.abs(P[k])) > small:
                    yield f"{name}: force of an open contact = {P[k]} at {t:.6g}"
                continue
            if not rows.system.bilateral and rows.gap[k] > self.tolerance * self.size_q:
                yield f"{name}: gap of a closed contact = {rows.gap[k]:.2e} at {t:.6g}"
            if abs(u[k, 0]) > self.tolerance * self.size_v:
                yield f"{name}: normal velocity of a closed contact = {u[k, 0]:.2e} at {t:.6g}"
            slip = u[k, 1:]
            speed = float(np.hypot(*slip))
            if mode == "stick" and speed > self.tolerance * self.size_v:
                yield f"{name}: slip velocity in stick = {slip} at {t:.6g}"
        unlawful = list(self.own_laws(t, rows, modes, u, P, small))
        if unlawful and rows.system.directions < 2 and self.redundant(rows, modes, u, P):
            if not self.shareable(rows, modes, u, P, small):
                yield f"reactions that no sharing of them makes lawful = {P.ravel()} at {t:.6g}"
            return
        yield from unlawful

    def own_laws(self, t: float, rows: Rows, modes: list[str], u: Array, P: Array, small: float) -> Iterator[str]:
        """Yield what the reactions of closed contacts violate as they are."""
        for k in (k for k, mode in enumerate(modes) if mode != "open"):
            name, mu, static = self.setting.contacts[k].name, rows.law[k, 0], rows.law[k, 1]
            normal, friction = P[k, 0], P[k, 1:]
            if not rows.system.bilateral and normal < -small:
                yield f"{name}: N = {normal:.3e} at {t:.6g}"
            most = static if modes[k] == "stick" else mu
            excess = float(np.hypot(*friction)) - most * abs(normal)
            if rows.system.directions and excess > small:
                yield f"{name}: |F| - mu N = {excess:.3e} at {t:.6g}"
            speed = float(np.hypot(*u[k, 1:]))
            if modes[k] == "slip" and speed > 1e-4 * self.size_v:
                wrong = float(np.max(np.abs(friction + mu * abs(normal) * u[k, 1:] / speed)))
                if wrong > 10.0 * small:
                    yield f"{name}: friction against slip, error = {wrong:.3e} at {t:.6g}"

    def redundant(self, rows: Rows, modes: list[str], u: Array, P: Array) -> bool:
        """Return whether the reactions of closed contacts are not determined by the motion and the laws of slip."""
        J: list[Array] = []
        for k, mode in enumerate(modes):
            if mode in ("closed", "stick"):
                J += list(rows.J[k, : 1 + rows.system.directions])
            elif mode == "slip":
                speed = max(float(np.hypot(*u[k, 1:])), 1e-300)
                J.append(rows.J[k, 0] - rows.law[k, 0] * np.sign(P[k, 0]) * (u[k, 1:] / speed) @ rows.J[k, 1:])
        return len(J) > 0 and bool(np.linalg.matrix_rank(np.array(J), tol=1e-7) < len(J))

    def shareable(self, rows: Rows, modes: list[str], u: Array, P: Array, small: float) -> bool:
        """Return whether lawful reactions (one tangent each) do the same as those of the run."""
        either = [(1.0, -1.0) if rows.system.bilateral else (1.0,)] * len(modes)
        return any(self._share(rows, modes, u, P, np.array(signs)) <= 10.0 * small for signs in product(*either))

    def _share(self, rows: Rows, modes: list[str], u: Array, P: Array, signs: Array) -> float:
        """Return by how much lawful reactions, the normal ones of given signs, miss what those of the run do."""
        need = np.einsum("kjn,kj->n", rows.J, P)
        J = (rows.J[:, :2] * np.stack([signs, np.ones_like(signs)], axis=1)[:, :, None]).reshape(-1, len(need))
        above: list[Array] = []
        equal: list[Array] = []
        bounds: list[tuple[float | None, float | None]] = []
        for k, mode in enumerate(modes):
            bounds += [(0.0, 0.0 if mode == "open" else None), (0.0, 0.0) if mode == "open" else (None, None)]
            row = np.zeros((2, len(J)))
            row[:, 2 * k + 1] = 1.0, -1.0
            if mode == "slip" and abs(u[k, 1]) > 1e-6 * self.size_v:
                row[0, 2 * k] = rows.law[k, 0] * np.sign(u[k, 1])
                equal.append(row[0])
            else:
                row[:, 2 * k] = -rows.law[k, 1]
                above += list(row)
        # smallest s with |J^T P - need| <= s, and the laws up to s
        cost = np.append(np.zeros(len(J)), 1.0)
        slack = [np.append(row, -1.0) for row in (*J.T, *-J.T, *above, *equal, *(-row for row in equal))]
        right = np.concatenate([need, -need, np.zeros(len(above) + 2 * len(equal))])
        found = linprog(cost, A_ub=np.array(slack), b_ub=right, bounds=[*bounds, (0.0, None)])
        return float(found.fun) if found.status == 0 else np.inf

    def impacts(self) -> Iterator[str]:
        t = self.run.t
        jumps = np.flatnonzero((t[1:] == t[:-1]) & ~np.isin(t[1:], self.kicks))
        for i in jumps:
            q, before, after = self.run.q[i], self.run.qdot[i], self.run.qdot[i + 1]
            if np.max(np.abs(self.run.q[i + 1] - q)) > self.tolerance * self.size_q:
                yield f"jump of positions = {self.run.q[i + 1] - q} at {t[i]:.6g}"
            if np.max(np.abs(after - before)) <= self.tolerance * self.size_v:
                continue
            rows = rows_at(self.setting.system, t[i], q, before, self.p)
            left = float(np.min(t[jumps[jumps > i]], initial=np.inf)) - float(t[i])
            yield from self.approaches(float(t[i]), rows, after, left)
            if not impacts_in_turn(rows, before, after):
                yield from self.impact(float(t[i]), rows, before, after)

    def approaches(self, t: float, rows: Rows, after: Array, left: float) -> Iterator[str]:
        """Check that contacts that approach after a jump have their own in time; `left` [s] is the time to it."""
        ends = rows.speeds(after)[:, 0]
        for k in range(len(rows.gap)):
            if not rows.system.bilateral and ends[k] < -1e-6 * self.size_v and rows.gap[k] < 1e-6 * ends[k] ** 2:
                if left > 1.01 * max(rows.gap[k], 0.0) / -ends[k] + 1e-13 * (1.0 + t):
                    yield f"{self.setting.contacts[k].name}: velocity after an impact = {ends[k]:.3e} at {t:.6g}"

    def impact(self, t: float, rows: Rows, before: Array, after: Array) -> Iterator[str]:
        """Check the laws of an impact; its impulses are those of the jump, where that determines them."""
        closed = [k for k in range(len(rows.gap)) if rows.system.bilateral or rows.gap[k] < 1e-6 * self.size_q]
        u, ends = rows.speeds(before), rows.speeds(after)
        if not np.any(rows.w):
            lost = 0.5 * before @ rows.M @ before - 0.5 * after @ rows.M @ after
            if lost < -self.tolerance * (before @ rows.M @ before):
                yield f"energy lost in an impact = {lost:.3e} at {t:.6g}"
        pairs = [(k, j) for k in closed for j in range(1 + rows.system.directions)]
        J = np.array([rows.J[k, j] for k, j in pairs])
        if not len(J):
            yield f"jump of velocities without a contact = {after - before} at {t:.6g}"
            return
        jump = rows.M @ (after - before)
        impulses, *_ = np.linalg.lstsq(J.T, jump, rcond=1e-9)
        small = 1e-5 * (np.max(np.abs(jump)) + np.max(np.abs(impulses)))
        if np.max(np.abs(J.T @ impulses - jump)) > small:
            yield f"jump of velocities that no impulse explains = {after - before} at {t:.6g}"
        if np.linalg.matrix_rank(J, tol=1e-7) < len(J):
            return
        P = np.zeros((len(rows.gap), 3))
        for (k, j), value in zip(pairs, impulses, strict=True):
            P[k, j] = value
        for k in closed:
            name, (mu, static, e) = self.setting.contacts[k].name, rows.law[k]
            normal, slip = P[k, 0], ends[k, 1:]
            if not rows.system.bilateral:
                if normal < -small:
                    yield f"{name}: normal impulse = {normal:.3e} at {t:.6g}"
                if normal > small and abs(ends[k, 0] + e * min(u[k, 0], 0.0)) > 1e-5 * self.size_v:
                    yield f"{name}: restitution = {ends[k, 0]:.3e} after {u[k, 0]:.3e} at {t:.6g}"
            speed, length = float(np.hypot(*slip)), float(np.hypot(*P[k, 1:]))
            if length > static * abs(normal) + small:
                yield f"{name}: impulse of friction = {length:.3e} with {normal:.3e} at {t:.6g}"
            if speed > 1e-4 * self.size_v and rows.system.directions:
                wrong = float(np.max(np.abs(P[k, 1:] + mu * abs(normal) * slip / speed)))
                if wrong > 10.0 * small:
                    yield f"{name}: impulse of friction against slip, error = {wrong:.3e} at {t:.6g}"
