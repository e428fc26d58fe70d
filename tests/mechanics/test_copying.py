"""Copies of equations: the same programs, and originals that later stages leave as they are."""

import pytest

import dalembert as da
from dalembert.ir.graph import Graph
from dalembert.lowering.programs import lower
from dalembert.mechanics.derive import derive
from dalembert.mechanics.equations import copied
from dalembert.reduction import FORMULATIONS, reduce
from dalembert.scene.reading import read

SCENES = {name: build for name, build in da.scenes.ALL.items() if name in ("chaplygin_sleigh", "rolling_sphere")}


def forms(graph):
    return [(n.op, tuple(a.index for a in n.args), n.payload, n.fingerprint, n.cost, n.deps) for n in graph.nodes]


@pytest.mark.parametrize("name", SCENES)
def test_a_copy_gives_the_same_programs_and_leaves_the_original(name):
    first, other = (derive(read(SCENES[name]())) for _ in range(2))
    before = forms(first.graph)
    for formulation in ("minimal", "projected"):
        assert str(lower(reduce(copied(first), formulation))) == str(lower(reduce(copied(other), formulation)))
        assert forms(first.graph) == before
    assert str(lower(reduce(first, "projected"))) == str(lower(reduce(copied(other), "projected")))
    assert forms(first.graph) != before  # so that a copy was needed


def test_a_copied_graph_knows_its_values():
    graph = Graph()
    x, y = graph.input("x"), graph.input("y")
    total = x * x + graph.decimal(0.1) * y
    other = graph.copy()
    assert forms(other) == forms(graph) and other.decimals == graph.decimals
    assert other.nodes[total.index] is other.input("x") * other.input("x") + other.decimal(0.1) * other.input("y")
    assert all(node.graph is other and all(arg.graph is other for arg in node.args) for node in other.nodes)
    other.input("z")
    assert "z" not in graph._inputs and len(graph.nodes) < len(other.nodes)


def test_nodes_of_a_copy_are_all_its_own():
    equations = derive(read(da.scenes.corner_plate(friction=True)))
    copy = copied(equations)

    shared = (id(copy.load_energy), id(copy.scene))

    def graphs(value):
        if hasattr(value, "graph") and hasattr(value, "fingerprint"):
            yield value.graph
        elif isinstance(value, (tuple, list)):
            for each in value:
                yield from graphs(each)
        elif isinstance(value, dict):
            yield from graphs(list(value.values()))
        elif hasattr(value, "__dataclass_fields__") and id(value) not in shared:
            yield from graphs([getattr(value, name) for name in value.__dataclass_fields__ if name != "graph"])

    assert {id(graph) for graph in graphs(copy)} == {id(copy.graph)}
    assert copy.contacts and copy.graph is not equations.graph


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_other_formulations_are_compiled_from_the_equations_at_hand(formulation, monkeypatch):
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy")
    expected = da.compile_model(da.scenes.chaplygin_sleigh(), backend="llvm", formulation=formulation).stages.program
    monkeypatch.setattr("dalembert.pipeline.read", None)
    monkeypatch.setattr("dalembert.pipeline.derive", None)
    assert str(model.variants.in_formulation(formulation).stages.program) == str(expected)


def test_modes_and_kept_invariants_are_compiled_from_the_equations_at_hand(monkeypatch):
    plate = da.compile_model(da.scenes.corner_plate(friction=True), backend="numpy")
    sleigh = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy", formulation="projected")
    monkeypatch.setattr("dalembert.pipeline.read", None)
    monkeypatch.setattr("dalembert.pipeline.derive", None)
    (contact,) = plate.contacts
    assert plate.mode(**{contact: "stick"}).stages.mode == ("stick",)
    start = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    run = sleigh.simulate((0, 1), start, {"m": 1.0, "b": 0.3, "I_C": 0.5}, project_invariants=["energy"])
    assert run.success
