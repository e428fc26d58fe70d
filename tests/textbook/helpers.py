"""What the tests of the textbook view share."""

import random

import numpy as np
import sympy as sp
from sympy.physics.vector import dynamicsymbols

import dalembert as da
from dalembert.scene.frames import Tree

TIME = dynamicsymbols._t
PRIME = (1 << 127) - 1
TRIALS = 2


class NotRational(Exception):
    """An expression is not a rational function of symbols, sines and cosines."""


def same(left, right):
    """Whether two expressions are equal.

    A rational function of symbols, sines and cosines is evaluated at random points of the field of 2^127 - 1 elements,
    where an angle stands for a point of the unit circle: what is not zero vanishes there with a chance of its degree in
    2^127. That is much faster than expanding it. Any other function is left to SymPy.
    """
    difference = sp.sympify(left) - sp.sympify(right)
    try:
        return all(_value(difference, random.Random(seed)) == 0 for seed in range(TRIALS))
    except NotRational:
        return sp.simplify(sp.expand(difference, trig=True)) == 0


def _value(expression, generator):
    """Return a rational expression at a random point of the field."""
    values = {}
    simple = sp.Symbol | sp.core.function.AppliedUndef
    angles = sorted({f.args[0] for f in expression.atoms(sp.sin, sp.cos, sp.tan, sp.cot)}, key=str)
    if not all(isinstance(angle, simple) for angle in angles):
        expression = expression.replace(sp.tan, lambda a: sp.sin(a) / sp.cos(a))
        expression = expression.replace(sp.cot, lambda a: sp.cos(a) / sp.sin(a))
        expression = expression.replace(lambda e: isinstance(e, sp.sin | sp.cos), sp.expand_trig)
        angles = sorted({f.args[0] for f in expression.atoms(sp.sin, sp.cos)}, key=str)
        if not all(isinstance(angle, simple) for angle in angles):
            raise NotRational(expression)
    for angle in angles:
        half = generator.randrange(PRIME)
        whole = pow(1 + half * half, -1, PRIME)
        sine, cosine = 2 * half * whole % PRIME, (1 - half * half) * whole % PRIME
        values |= {sp.sin(angle): sine, sp.cos(angle): cosine}
        values |= {sp.tan(angle): sine * pow(cosine, -1, PRIME), sp.cot(angle): cosine * pow(sine, -1, PRIME)}
    leaves = {e for e in expression.atoms(sp.Derivative) if isinstance(e.expr, sp.core.function.AppliedUndef)}
    leaves |= expression.atoms(sp.Symbol, sp.core.function.AppliedUndef)
    values |= {leaf: generator.randrange(PRIME) for leaf in sorted(leaves, key=str)}
    return _evaluate(expression, values)


def _evaluate(e, values):
    """Return an expression over the field, `values` holding what is known of its parts."""
    if e not in values:
        if e.is_Rational:
            values[e] = e.p * pow(e.q, -1, PRIME)
        elif e.is_Add:
            values[e] = sum(_evaluate(a, values) for a in e.args) % PRIME
        elif e.is_Mul:
            product = 1
            for a in e.args:
                product = product * _evaluate(a, values) % PRIME
            values[e] = product
        elif e.is_Pow and e.exp.is_Integer:
            values[e] = pow(_evaluate(e.base, values), int(e.exp), PRIME)
        else:
            raise NotRational(e)
    return values[e]


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


def agreement(scene, formulation="auto", backend="numpy", count=3, view=None):
    """Return the largest relative difference of accelerations, and of reactions, between textbook and compiled.

    At random states that fulfil the constraints. Accelerations are relative to their largest or, where that is less,
    to one; so are reactions. Returns None where no state fulfils the constraints.
    """
    view = da.lagrange(scene) if view is None else view
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
