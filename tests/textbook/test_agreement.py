"""Textbook view and compiled kernels agree: the ready scenes in every formulation, and 200 random scenes.

``make test`` takes a part of these, ``make test-all`` the others.
"""

import functools

import hypothesis
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.reduction import FORMULATIONS
from textbook.helpers import agreement, frame, point
from textbook.random_scenes import scenes

RTOL = 1e-10
BLOCKS = [(0, 5), *(pytest.param(block, 25, marks=pytest.mark.matrix) for block in range(8))]
"""Seeds, and numbers of scenes."""


def released_corner_plate():
    scene = da.scenes.corner_plate()
    return scene.release(dynamicsymbols("y"), point(scene, "A"), scene.frame.y)


def released_sphere():
    scene = da.scenes.rolling_sphere()
    return scene.release(dynamicsymbols("z"), point(scene, "G"), scene.frame.z)


def released_edge_plate():
    scene = da.scenes.edge_plate()
    edge = frame(scene, "A")
    return scene.release(dynamicsymbols("phi"), edge, edge.y)


def imposed_edge_plate():
    scene = da.scenes.edge_plate()
    return scene.impose(scene.coordinates[2])


SCENES = {
    **da.scenes.ALL,
    "corner plate, y released": released_corner_plate,
    "sphere, z released": released_sphere,
    "edge plate, rotation released": released_edge_plate,
    "edge plate, z imposed": imposed_edge_plate,
}


@functools.cache
def viewed(name):
    scene = SCENES[name]()
    return scene, da.lagrange(scene)


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
@pytest.mark.parametrize("name", SCENES)
def test_ready_scenes(name, formulation):
    scene, view = viewed(name)
    try:
        differences = agreement(scene, formulation, view=view)
    except da.errors.FormulationError:
        pytest.skip("the formulation cannot serve the scene")
    assert differences is not None
    assert max(differences) < RTOL


@pytest.mark.parametrize("backend", ["llvm", "jax"])
@pytest.mark.parametrize("name", sorted(da.scenes.ALL))
def test_ready_scenes_with_other_backends(name, backend):
    if backend == "jax":
        pytest.importorskip("jax")
    scene, view = viewed(name)
    assert max(agreement(scene, backend=backend, view=view)) < RTOL


def test_reactions_are_computed_only_when_asked_for():
    lean = da.compile_model(da.scenes.corner_plate(), backend="numpy")
    full = da.compile_model(da.scenes.corner_plate(), backend="numpy", outputs=["N_Q", "F_Q"])
    assert "outputs" not in lean.stages.program
    assert "outputs" in full.stages.program
    assert lean.stages.program.kernel("rhs") == full.stages.program.kernel("rhs")


def test_symbolic_reactions_are_those_of_the_compiled_corner_plate():
    scene = released_corner_plate()
    view = da.lagrange(scene)
    model = da.compile_model(scene, backend="numpy", outputs=["N_A", "N_Q", "F_Q"])
    names = ["N_A", "N_Q", "F_Q"]
    function = view.system.function([view.system.plain(view.reactions[name]) for name in names])
    for state in view._states.states[:4]:
        p = {x.name: value for x, value in zip(view.system.p, state.p, strict=True)}
        layout = model.layout
        initial = dict(zip((*layout.coordinates, *layout.rates), (*state.q, *state.v), strict=True))
        run = model.simulate((0, 0), initial, p)
        found = np.array([run[name][0] for name in names])
        np.testing.assert_allclose(found, function(state.t, state.q, state.v, state.p), rtol=1e-9, atol=1e-10)


def describe(scene):
    lines = [f"coordinates {scene.coordinates}", f"gravity {scene.gravity}", f"loads {scene.loads}"]
    for body in scene.bodies:
        centre = getattr(body, "masscenter", None) or body.point
        lines.append(f"{body} at {centre.pos_from(scene.origin)}")
    lines += [f"joint on {j.body} at {j.at.pos_from(scene.origin)}: {j.force}, {j.torque}" for j in scene.joints]
    lines.append(f"holonomic {scene.holonomic_constraints}, nonholonomic {scene.nonholonomic_constraints}")
    return "\n".join(lines)


@pytest.mark.parametrize("block, count", BLOCKS)
def test_random_scenes(block, count):
    """One to three bodies, random joints, constraints, loads and reactions, compared at random states."""
    compared = {"accelerations": 0, "reactions": 0}

    @hypothesis.seed(block)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate],  # a failing scene is shown as it is: shrinking takes minutes
        suppress_health_check=list(HealthCheck),
    )
    @given(scenes(5 if block == 0 else 4))
    def check(scene):
        hypothesis.note(describe(scene))
        try:
            differences = agreement(scene)
        except da.errors.ConstraintError:
            assume(False)  # the constraints that were drawn depend on each other
        assume(differences is not None)
        compared["accelerations"] += 1
        compared["reactions"] += bool(scene.joints)
        assert differences[0] < RTOL
        assert differences[1] < RTOL

    check()
    assert compared["accelerations"] >= count
    assert compared["reactions"] >= count // 5
