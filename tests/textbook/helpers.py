"""What the tests of the textbook view share."""

import numpy as np
import sympy as sp
from sympy.physics.vector import dynamicsymbols

import dalembert as da
from dalembert.scene.tree import Tree

TIME = dynamicsymbols._t


def same(left, right):
    """Whether the difference of two expressions simplifies to zero."""
    return sp.simplify(sp.expand(sp.sympify(left) - sp.sympify(right), trig=True)) == 0


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
    known = {x.name: x for x in da.lagrange(scene).system.p}
    known |= {str(q.func): q for q in scene.coordinates}
    known |= {x.name: x for x in da.lagrange(scene).unknowns}
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
