"""First integrals: momenta of ignorable coordinates, and energy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np
import sympy as sp

from ..arrays import FloatArray
from ..frozen import frozen
from ..scene.expressions.compiled_functions import CompiledCall
from .energy import readable
from .numeric import TOLERANCE, null_basis, rank

if TYPE_CHECKING:
    from .numeric import States


@final
@frozen
class FirstIntegral:
    """An expression that is constant along every motion.

    Attributes
    ----------
    name : str
        Kind of the integral.
    expression : Expr
        In coordinates, rates, time and parameters.
    reason : str
        Why it is constant.
    """

    name: str
    expression: Any
    reason: str


@final
class FirstIntegrals(tuple[FirstIntegral, ...]):
    """The first integrals found, and why others are none.

    Attributes
    ----------
    reasons : tuple of str
        One line for every coordinate, or for the energy, that gives no first integral.
    independent : int
        Number of independent ones on the constraints.
    """

    reasons: tuple[str, ...]
    independent: int

    def __new__(cls, found: Sequence[FirstIntegral], reasons: Sequence[str], independent: int) -> FirstIntegrals:
        """Return the tuple with its attributes."""
        self = super().__new__(cls, found)
        self.reasons, self.independent = tuple(reasons), independent
        return self

    @property
    def expressions(self) -> tuple[Any, ...]:
        """The constant expressions."""
        return tuple(item.expression for item in self)

    def __str__(self) -> str:
        from .printing import text

        lines = [f"{text(i.expression)} = const   ({i.name}: {i.reason})" for i in self]
        return "\n".join([*lines, *(f"none from {reason}" for reason in self.reasons)])


def first_integrals(
    coordinates: Sequence[Any],
    time: Any,
    kinetic: Any,
    gravity_potential: Any,
    loads: Sequence[Any],
    rheonomic: Sequence[str],
    states: States,
) -> FirstIntegrals:
    """Return the first integrals of a scene.

    Parameters
    ----------
    coordinates, time : dynamicsymbols and their time
    kinetic : Expr
        Kinetic energy.
    gravity_potential : Expr
        Potential energy of gravity.
    loads : sequence of Expr, length n_q
        Power coefficients of the given actions other than gravity.
    rheonomic : sequence of str
        The constraints that contain time or a drift, for the reasons.
    states : States
        Random states; everything found is tested along the motion there.
    """
    found, reasons = _momenta(coordinates, time, kinetic, states)
    energy = _energy(coordinates, time, kinetic, gravity_potential, loads, rheonomic, states)
    if isinstance(energy, FirstIntegral):
        found.append(energy)
    else:
        reasons.append(energy)
    return FirstIntegrals(found, reasons, _independent([i.expression for i in found], states))


def _relative(values: FloatArray, scale: FloatArray) -> bool:
    return bool(np.all(np.abs(values) <= TOLERANCE * np.maximum(scale, 1.0)))


def _momenta(
    coordinates: Sequence[Any], time: Any, kinetic: Any, states: States
) -> tuple[list[FirstIntegral], list[str]]:
    """Return constant combinations of the momenta dT/dq_dot with constant weights."""
    rates = [q.diff(time) for q in coordinates]
    momenta = [kinetic.diff(v) for v in rates]
    moving = [readable(kinetic.diff(q)) != 0 for q in coordinates]
    names = [str(q.func) for q in coordinates]
    changes = states.rates(momenta)
    values = states.values(momenta)
    found: list[FirstIntegral] = []
    reasons = []
    rest = []
    for i, name in enumerate(names):
        if not _relative(changes[:, i], np.abs(changes).max()):
            rest.append(i)
            why = (
                f"{name} occurs in the kinetic energy"
                if moving[i]
                else f"{name} is cyclic, but the forces have power on it"
            )
            reasons.append(f"dT/d{name}_dot: {why}")
        elif _relative(values[:, i], np.abs(values).max()):
            reasons.append(f"dT/d{name}_dot: it vanishes with the constraints")
        else:
            why = f"{name} does not occur in T and no force has power on it"
            if moving[i]:
                why = f"dT/d{name} and the power coefficient of {name} cancel along every motion"
            found.append(FirstIntegral(f"momentum of {name}", readable(momenta[i]), why))
    for weights in _constant_weights(changes[:, rest]):
        combined = readable(sum((w * momenta[i] for w, i in zip(weights, rest, strict=True)), sp.S.Zero))
        if not _relative(states.values([combined]), np.abs(values).max()):
            label = " + ".join(
                names[i] if w == 1 else f"{w} {names[i]}" for w, i in zip(weights, rest, strict=True) if w
            )
            found.append(FirstIntegral(f"momentum of {label}", combined, "the forces have no power on it"))
    return found, reasons


def _constant_weights(changes: FloatArray) -> list[list[Any]]:
    """Return combinations of columns that vanish, as reduced rows of simple rational numbers."""
    if changes.size == 0:
        return []
    basis = null_basis(changes, changes.shape[1]).T
    if not len(basis):
        return []
    work = basis.copy()
    for row in range(len(work)):
        column = int(np.argmax(np.abs(work[row])))
        work[row] /= work[row, column]
        for other in range(len(work)):
            if other != row:
                work[other] -= work[other, column] * work[row]
    rational = [[sp.Rational(str(round(float(x), 8))).limit_denominator(64) for x in row] for row in work]
    good = []
    for row, exact in zip(work, rational, strict=True):
        if all(abs(float(e) - x) < 1e-7 for e, x in zip(exact, row, strict=True)):
            good.append(exact)
    return good


def _energy(
    coordinates: Sequence[Any],
    time: Any,
    kinetic: Any,
    gravity_potential: Any,
    loads: Sequence[Any],
    rheonomic: Sequence[str],
    states: States,
) -> FirstIntegral | str:
    """Return the integral of energy, or why there is none."""
    rates = [q.diff(time) for q in coordinates]
    potential = _potential(loads, coordinates, time)
    faults = []
    plain = states.system.plain
    if plain(kinetic).has(states.system.t):
        faults.append("the kinetic energy depends explicitly on time")
    if plain(gravity_potential).has(states.system.t):
        faults.append("the potential of gravity depends explicitly on time")
    faults += [f"the constraint {label} moves with time" for label in rheonomic]
    if potential is None:
        faults.append("the loads have no potential")
        potential = sp.S.Zero
    moments = sum((v * kinetic.diff(v) for v in rates), sp.S.Zero)
    homogeneous = not np.abs(states.values([moments - 2 * kinetic])).max(initial=0) > TOLERANCE
    energy = (kinetic if homogeneous else moments - kinetic) + gravity_potential + potential
    changes = states.rates([energy])
    scale = np.abs(states.rates([kinetic])).max(initial=0)
    if _relative(changes, scale):
        name = "energy" if homogeneous else "Jacobi's integral"
        reason = "T + V: constraints without time, ideal joints, given forces with a potential"
        return FirstIntegral(name, readable(energy), reason if homogeneous else "time does not occur in T - V")
    return "energy: " + ("; ".join(faults) or "the given forces have power that no potential accounts for")


def _potential(loads: Sequence[Any], coordinates: Sequence[Any], time: Any) -> Any:
    """Return V with loads = -dV/dq, or None."""
    loads = [readable(e) for e in loads]
    if all(e == 0 for e in loads):
        return sp.S.Zero
    names = [sp.Symbol(f"q_{i}", real=True) for i in range(len(coordinates))]
    table = dict(zip(coordinates, names, strict=True))
    if any(e.has(sp.Derivative, CompiledCall) for e in loads):
        return None
    plain = [e.xreplace(table) for e in loads]
    if any(e.has(time) or e.count_ops() > 200 for e in plain):
        return None
    potential = sp.S.Zero
    for e, q in zip(plain, names, strict=True):
        rest = sp.simplify(e + potential.diff(q))
        if rest != 0:
            part = sp.integrate(rest, q)
            if part.has(sp.Integral):
                return None
            potential -= part
    if any(sp.simplify(e + potential.diff(q)) != 0 for e, q in zip(plain, names, strict=True)):
        return None
    return potential.xreplace({symbol: q for q, symbol in table.items()})


def _independent(expressions: Sequence[Any], states: States) -> int:
    """Return how many of the integrals are independent on the manifold of the constraints."""
    system = states.system
    if not expressions or not states.states:
        return 0
    variables = [*system.q, *system.v]
    constraints = [*system.residual, *system.velocity]
    rows = [e.diff(x) for e in (*map(system.plain, expressions), *constraints) for x in variables]
    function, s = system.function(rows), states.states[0]
    gradients = np.array(function(s.t, s.q, s.v, s.p), dtype=float).reshape(-1, len(variables))
    return rank(gradients) - rank(gradients[len(expressions) :])
