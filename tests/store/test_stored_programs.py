"""Models that travel to the workers of a cluster as their programs."""

import pickle
import shutil
import subprocess
import sys

import numpy as np
import pytest
from sympy import Abs, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.store.chunks import SweptModel
from dalembert.store.cluster import packed, unpacked
from dalembert.store.store import Store

pytest.importorskip("zarr")
pytest.importorskip("xarray")

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98}
DROPPED = {"x": 0.0, "y": 1.0, "x_dot": 0.5, "y_dot": 0.0}
DRIVEN = {"q": 0.3, "q_dot": 0.0, "e": 0.1}
q, e, u, force = dynamicsymbols("q e u force")
k, r = symbols("k r", positive=True)


def driven():
    """Return a model with a table, an input, first-order states, a controller, and a kink in time."""
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", q * N.x)
    scene = da.Scene("driven", frame=N, origin=O, coordinates=[q])
    scene.add_bodies(Particle("p", P, 1))
    scene.add_inputs(u, force)
    spring = da.table(q, [-2.0, -1.0, 0.0, 1.5, 3.0], [-5.0, -1.0, 0.0, 1.0, 4.0], kind="cubic", extrapolate="linear")
    scene.add_loads((P, (force + u - spring + Abs(sin(3 * dynamicsymbols._t))) * N.x))
    scene.add_controllers(da.Controller("p", period=0.25, states={e: e + r - q}, inputs={u: k * e}))
    return da.compile_model(scene)


def records(count):
    return {"force": da.samples(np.linspace(0, 2, 9), np.random.default_rng(4).normal(size=(count, 9)))}


ELSEWHERE = """
import pickle, sys
import numpy as np
import dalembert as da
from dalembert import pipeline
from dalembert.store.cluster import unpacked

def derive(*given):
    raise RuntimeError("derived again")

pipeline.derive = pipeline.read = derive
for data, given, options in pickle.load(open(sys.argv[1], "rb")):
    found = unpacked(data).model.sweep(*given, **options).to_xarray()
    print(*(found[name].to_numpy().tobytes().hex() for name in sorted(found.data_vars)))
"""


def test_another_process_derives_nothing_and_has_the_same_bits(tmp_path):
    ball = da.compile_model(da.scenes.bouncing_ball(), outputs=["N"])
    cases = [
        (SweptModel(driven()), ((0, 2), DRIVEN, {"k": 2.0, "r": np.linspace(0.5, 1, 5)}), {"inputs": records(5)}),
        (SweptModel(ball), ((0, 2), DROPPED, {"m": 1.0, "g": 9.81, "e": np.linspace(0.3, 0.9, 6)}), {}),
    ]
    path = tmp_path / "models"
    path.write_bytes(pickle.dumps([(packed(model), given, options) for model, given, options in cases]))
    command = [sys.executable, "-c", ELSEWHERE, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for (model, given, options), line in zip(cases, done.stdout.splitlines(), strict=True):
        found = model.model.sweep(*given, **options).to_xarray()
        assert line == " ".join(found[name].to_numpy().tobytes().hex() for name in sorted(found.data_vars))


def test_a_graph_of_any_depth_is_packed():
    """Nodes that refer to each other one by one are deeper than the stack of Python."""
    from dalembert.ir.graph import Graph

    graph = Graph()
    x, node = graph.input("x"), graph.input("y")
    for number in range(3000):
        node = graph.call("sin", node + x) if number % 2 else node * x
    same, last = pickle.loads(pickle.dumps((graph, node)))
    assert last is same.nodes[node.index] and last.graph is same
    assert [(n.op, n.fingerprint, n.cost, n.deps) for n in same.nodes] == [
        (n.op, n.fingerprint, n.cost, n.deps) for n in graph.nodes
    ]
    assert [[a.index for a in n.args] for n in same.nodes] == [[a.index for a in n.args] for n in graph.nodes]
    assert same.input("x") is same.nodes[x.index] and (same.input("x") + 1) - 1 is same.input("x")


def test_what_a_model_does_not_enforce_stays_so():
    model = da.compile_model(da.scenes.chaplygin_sleigh(), formulation="projected")
    loose = model.variants.without_constraints((0,))
    again = unpacked(packed(SweptModel(loose))).model
    assert again == loose and again != model and again.note == loose.note


@pytest.fixture(scope="module")
def client():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def test_a_store_that_was_begun_anew_under_its_name(tmp_path, client):
    """A worker that knows the sweep does not take the store of that name for the one that it wrote before."""
    model, path = da.compile_model(da.scenes.chaplygin_sleigh()), tmp_path / "s.zarr"
    cases = da.random_cases(100, 2, b=da.uniform(0.1, 0.5), theta_dot=da.normal(2.0, 0.1))
    given, whole = ((0, 1), START, {"m": 1, "I_C": 0.5}), None
    for chunk in (40, 25, 60):
        shutil.rmtree(path, ignore_errors=True)
        found = model.sweep(*given, grid=cases, to=path, chunk=chunk, client=client)
        whole = model.sweep(*given, grid=cases) if whole is None else whole
        np.testing.assert_array_equal(found["x"], whole["x"])
    assert not [name for name in Store.open(path).group["progress"].array_keys() if "program" in name]


def test_inputs_and_controllers_of_cases_on_a_cluster(tmp_path, client):
    model, given = driven(), ((0, 2), DRIVEN, {"k": 2.0, "r": np.linspace(0.5, 1, 12)})
    stored = model.sweep(*given, inputs=records(12), to=tmp_path / "s.zarr", chunk=5, client=client)
    whole = model.sweep(*given, inputs=records(12)).to_xarray()
    assert {"e", "u", "q"} <= set(stored.data_vars)
    for name in whole.variables:
        np.testing.assert_array_equal(stored[name], whole[name])


def test_a_damaged_program_is_not_read(tmp_path):
    data, path = packed(SweptModel(da.compile_model(da.scenes.chaplygin_sleigh()))), tmp_path / "s.zarr"
    store = Store.create(path, 1, {"dalembert_digest": "0"})
    store.keep_program("0" * 32, data)
    assert store.program("0" * 32) is None
