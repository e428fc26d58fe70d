"""What the tests of the textbook view share."""

import numpy as np
import sympy as sp
from sympy.physics.vector import dynamicsymbols

import dalembert as da
from dalembert.scene.tree import Tree

TIME = dynamicsymbols._t


def same(left, right):
    """Whether the difference of two expressions simplifies to zero.

    That of long ones is a polynomial over a common denominator, once tangents of half angles stand for the angles;
    expanding it is much faster than cancelling what it is divided by.
    """
    difference = sp.sympify(left) - sp.sympify(right)
    if difference.count_ops() <= 150:
        return sp.simplify(sp.expand(difference, trig=True)) == 0
    return not _numerator(difference)


def _numerator(expression):
    """Return the numerator of a rational expression of sines, cosines and other symbols, as a polynomial."""
    expression = expression.replace(sp.tan, lambda x: sp.sin(x) / sp.cos(x))
    expression = expression.replace(sp.cot, lambda x: sp.cos(x) / sp.sin(x))
    expression = expression.replace(lambda e: isinstance(e, sp.sin | sp.cos), sp.expand_trig)
    atoms = expression.atoms(sp.sin, sp.cos)
    table = {}
    for angle in sorted({f.args[0] for f in atoms}, key=str):
        u = sp.Dummy("u")
        table |= {sp.sin(angle): 2 * u / (1 + u**2), sp.cos(angle): (1 - u**2) / (1 + u**2)}
    expression = expression.xreplace(table)
    leaves = expression.atoms(sp.Derivative, sp.core.function.AppliedUndef)
    expression = expression.xreplace({e: sp.Dummy("v") for e in sorted(leaves, key=str)})
    symbols = sorted(expression.free_symbols, key=str)
    ring = sp.ring(symbols, sp.QQ)[0]
    return _fraction(expression, ring, dict(zip(symbols, ring.gens, strict=True)))[0]


def _fraction(e, ring, generators):
    """Return numerator and denominator of an expression, nothing cancelled."""
    if e in generators:
        return generators[e], ring.one
    if e.is_Rational:
        return ring(e.p), ring(e.q)
    if e.is_Pow and e.exp.is_Integer:
        numerator, denominator = _fraction(e.base, ring, generators)
        if e.exp < 0:
            numerator, denominator = denominator, numerator
        return numerator ** abs(int(e.exp)), denominator ** abs(int(e.exp))
    parts = [_fraction(a, ring, generators) for a in e.args]
    assert e.is_Add or e.is_Mul, e
    numerator, denominator = parts[0]
    for n, d in parts[1:]:
        if e.is_Mul:
            numerator, denominator = numerator * n, denominator * d
        elif d == denominator:
            numerator += n
        else:
            numerator, denominator = numerator * d + n * denominator, denominator * d
    return numerator, denominator


def same_vector(left, right, frame):
    """Whether two SymPy vectors are equal."""
    difference = (left - right).to_matrix(frame) if left != right else sp.zeros(3, 1)
    return all(same(e, 0) for e in difference)


def point(scene, name):
    return next(p for p in Tree(scene.origin, "_pos_dict").parent if p.name == name)


def frame(scene, name):
    return next(f for f in Tree(scene.frame, "_dcm_dict").parent if f.name == name)


def symbols_of(scene, names):
    """Return symbols of a scene by name, with the assumptions that the scene gave them."""
    view = da.lagrange(scene)
    known = {str(q.func): q for q in scene.coordinates} | {x.name: x for x in view.unknowns}
    expressions = [view.kinetic_energy, *map(view.power_coefficient, scene.coordinates), *scene.holonomic_constraints]
    expressions += scene.nonholonomic_constraints
    for e in expressions:
        known |= {x.name: x for x in sp.sympify(e).atoms(sp.Symbol) if x.name not in known}
    return [known[name] for name in names.split()]


def agreement(scene, formulation="auto", backend="numpy", count=3):
    """Return the largest relative difference of accelerations, and of reactions, between textbook and compiled.

    At random states that fulfil the constraints. Accelerations are relative to their largest or, where that is less,
    to one; so are reactions. Returns None where no state fulfils the constraints.
    """
    view = da.lagrange(scene)
    system, states = view.system, view._states.states
    if not states:
        return None
    unknowns = [str(x) for x in view.unknowns]
    outputs = [str(x) for x in view.determined] if view._solution.carries() else []
    model = da.compile_model(scene, backend=backend, formulation=formulation, outputs=outputs)
    layout, worst = model.layout, np.zeros(2)
    for state in states[:count]:
        known = {x.name: value for x, value in zip(system.p, state.p, strict=True)}
        p = {name: known.get(name, 0.7) for name in layout.parameters}  # some occur in the potential only
        accelerations, reactions = system.motion(state.t, state.q, state.v, state.p)
        found = model.accelerations(state.t, state.q, state.v, p)
        worst[0] = max(worst[0], relative(found, accelerations))
        if outputs:
            initial = dict(zip((*layout.coordinates, *layout.rates), (*state.q, *state.v), strict=True))
            run = model.simulate((state.t, state.t), initial, p)
            expected = np.array([reactions[unknowns.index(name)] for name in outputs])
            worst[1] = max(worst[1], relative(np.array([run[name][0] for name in outputs]), expected))
    return tuple(worst)


def relative(found, expected):
    return float(np.abs(found - expected).max() / max(1.0, np.abs(expected).max()))
