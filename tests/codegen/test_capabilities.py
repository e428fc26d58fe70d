"""What backends declare that they offer, and the one error for what they do not."""

import pytest
from sympy import Heaviside, symbols

import dalembert as da
from dalembert.codegen import BACKENDS, backend_named
from dalembert.codegen.base import Capability
from dalembert.errors import CapabilityError, OptionError

USES = {
    Capability.KERNEL_FUNCTIONS: lambda model: model.kernels,
    Capability.VECTOR_FIELD: lambda model: model.vector_field(
        0.0, model.state({"x": 0.0, "x_dot": 0.0}, {"m": 1.0}), model.parameter_vector({"m": 1.0})
    ),
    Capability.STATE_FUNCTIONS: lambda model: model.functions.energy,
    Capability.SOLVE_FUNCTION: lambda model: model.solve_fn(),
}


def particle(force):
    from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

    (x,), m = dynamicsymbols("x,"), symbols("m", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("particle", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", P, m))
    scene.add_loads((P, force(dynamicsymbols._t) * N.x))
    return scene


@pytest.mark.parametrize("backend", BACKENDS)
def test_backends_offer_what_they_declare_and_nothing_else(backend):
    if backend == "jax":
        pytest.importorskip("jax")
        pytest.importorskip("diffrax")
    model = da.compile_model(particle(lambda t: 1), backend=backend)
    for capability, use in USES.items():
        if capability in backend_named(backend).capabilities:
            assert use(model) is not None
            continue
        with pytest.raises(CapabilityError, match="compile with backend=") as refusal:
            use(model)
        assert str(refusal.value) == capability.value


def test_every_capability_is_declared_by_some_backend_and_used_here():
    pytest.importorskip("jax")
    pytest.importorskip("diffrax")
    declared = set().union(*(backend_named(name).capabilities for name in BACKENDS))
    assert declared == set(Capability) == set(USES)


def test_a_scene_may_lack_what_its_backend_offers():
    model = da.compile_model(particle(lambda t: Heaviside(t - 1)), backend="numba")
    with pytest.raises(CapabilityError, match=r"has no model\.kernels: its functions of time have kinks or jumps"):
        _ = model.kernels
    assert issubclass(CapabilityError, OptionError)
