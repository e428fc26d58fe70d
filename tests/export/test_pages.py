"""Pages that simulate: their numbers beside `simulate` and `animate`, their size, and what is refused."""

import numpy as np
import pytest
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from corpus.named_scenes import READY
from dalembert.errors import CapabilityError, MissingExtraError, OptionError, UnknownNameError
from dalembert.export import compilers, page
from dalembert.mechanics.skeleton import skeleton
from dalembert.methods.status import Status
from export.pages import need_pages, parts, run_of
from hard_cases import hard_case

LARGEST = 500_000
"""Bytes that a page may have."""

SLEIGH = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
NUMBERS = {"m": 1, "b": 0.3, "I_C": 0.5}


def assert_equal_to(found, run, names, rtol=1e-11, atol=1e-11):
    for name in names:
        np.testing.assert_allclose(found[name], run[name], rtol=rtol, atol=atol, err_msg=name)


@pytest.mark.parametrize("name", ["rolling_sphere", "corner_plate", "edge_plate"])
def test_ready_scenes_move_as_in_simulate(tmp_path, name):
    need_pages()
    case = READY[f"ready: {name}"]
    model = da.compile_model(case.build())
    given = {"initial": case.initial, "parameters": case.parameters}
    path = model.export(tmp_path / "page.html", "page", t_span=case.span, **given)
    times = np.linspace(*case.span, 7)
    printed, found = run_of(path, times)
    run = model.simulate(case.span, case.initial, case.parameters, t_eval=times)
    assert printed["status"] == 0
    assert_equal_to(found, run, model.layout.variables)
    np.testing.assert_allclose(found["kinetic"] + found["potential"], run["energy"], rtol=1e-11)
    assert path.stat().st_size < LARGEST


@pytest.mark.parametrize(
    ("name", "method"),
    [
        ("pendulum, Cartesian (IFToMM A01)", "radau"),
        ("slider-crank", "dop853"),
        ("heavy top, fast precession", "taylor"),
    ],
)
def test_hard_cases_by_every_kind_of_step(tmp_path, name, method):
    need_pages()
    case = hard_case(name)
    model, end = case.compile("auto"), min(case.times()[-1], 2.0)
    options = {"method": method, "rtol": 1e-10, "atol": 1e-12}
    path = model.export(
        tmp_path / "page.html", "page", initial=case.initial, parameters=case.parameters, t_span=(0, end), **options
    )
    times = np.linspace(0, end, 5)
    _, found = run_of(path, times)
    run = model.simulate((0, end), case.initial, case.parameters, t_eval=times, **options)
    assert_equal_to(found, run, model.layout.variables, rtol=1e-8, atol=1e-8)
    finer, better = run_of(path, times, module="finer")
    estimate = model.simulate(
        (0, end), case.initial, case.parameters, t_eval=times, error_estimate=True, **options
    ).error_estimate
    assert finer["steps"] > 0
    for variable in model.layout.coordinates:
        np.testing.assert_allclose(abs(found[variable] - better[variable]), estimate[variable], atol=1e-9)


def coin():
    """Return a coin that spins on a spring over a ground, with every kind of shape."""
    x, phi = dynamicsymbols("x phi")
    m, r, k = symbols("m r k", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    C = N.orientnew("C", "Axis", (phi, N.z))
    G = O.locatenew("G", x * N.x + 2 * r * N.z)
    P = G.locatenew("P", 2 * r * C.y)
    scene = da.Scene("spun coin", frame=N, origin=O, coordinates=[x, phi])
    scene.add_bodies(RigidBody("coin", G, C, m, (inertia(C, 1, 1, m * r**2), G)), Particle("tip", P, m))
    scene.add_loads((G, -k * x * N.x))
    scene.add_shapes(
        {
            "coin": [da.Disk(r, axis=C.x + C.y), da.Cylinder(r / 2, 3 * r, axis=C.z), da.Box(r, 2 * r, r / 5)],
            "tip": da.Sphere(r / 4, color="tab:green"),
            "spring": da.Spring(O, G, radius=r / 8, coils=5),
            "rod": da.Rod(G, P),
            "floor": da.Ground(N.z, size=8 * r),
            "track": da.Path(P),
        }
    )
    return scene


def test_points_axes_and_lengths_follow_the_run_and_the_parameters(tmp_path):
    need_pages()
    scene = coin()
    model = da.compile_model(scene)
    start, numbers = {"x": 0.3, "phi": 0.1, "x_dot": 0, "phi_dot": 2}, {"m": 1, "r": 0.2, "k": 3}
    path = model.export(tmp_path / "coin.html", "page", initial=start, parameters=numbers, t_span=(0, 2))
    picture = parts(path)[0]["picture"]
    times, changed = [0.0, 0.7, 2.0], {**numbers, "r": 0.3}
    _, found = run_of(path, times, {"r": 0.3})
    run = model.simulate((0, 2), start, changed, t_eval=times)
    drawn = skeleton(scene, model.layout.parameters, ["O", "P"])
    c = np.array([changed[name] for name in model.layout.parameters], float)
    positions, axes = drawn.at(run.t, run.q, c)
    count, numbers_at = len(picture["points"]), 3 * len(picture["points"]) + 9
    there = found["picture"][:, : 3 * count].reshape(3, count, 3)
    for number, name in enumerate(picture["points"]):
        np.testing.assert_allclose(there[:, number], positions[:, drawn.points.index(name)], atol=1e-10)
    np.testing.assert_allclose(found["picture"][:, 3 * count : numbers_at].reshape(3, 1, 3, 3), axes, atol=1e-10)
    lengths = {shape["kind"]: found["picture"][0, numbers_at:][shape["first"] :][: shape["count"]].tolist()
               for shape in picture["shapes"]}  # fmt: skip
    expected = {"disk": [0.3, 1, 1, 0], "cylinder": [0.15, 0.9, 0, 0, 1], "box": [0.3, 0.6, 0.06], "sphere": [0.075],
                "spring": [0.0375], "rod": [], "ground": [0, 0, 1, 2.4], "path": []}  # fmt: skip
    assert {kind: pytest.approx(values) for kind, values in expected.items()} == lengths
    assert picture["up"] == [0, 0, 1]
    assert next(shape for shape in picture["shapes"] if shape["kind"] == "sphere")["color"] == "#2ca02c"


def test_meshes_have_their_triangles():
    scene = coin()
    triangle = ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    still = da.Mesh(triangle, offset=[0, 0, 2], fixed=True)
    scene.add_shapes({"coin": da.Mesh(triangle, scale=0.5, color="red"), "wall": still})
    layout = da.compile_model(scene, backend="numpy").layout
    described = page.picture_of(scene, {"m": 1, "r": 0.2, "k": 3}, layout).description["shapes"]
    turned, wall = (shape for shape in described if shape["kind"] == "mesh")
    assert turned["vertices"] == [[0, 0, 0], [0.5, 0, 0], [0, 0.5, 0]] and turned["faces"] == [[0, 1, 2]]
    assert (turned["body"], turned["point"], turned["frame"], turned["color"]) == (0, 0, 0, "red")
    assert wall["vertices"] == [[0, 0, 2], [1, 0, 2], [0, 1, 2]] and wall["color"] is None
    assert (wall["body"], wall["point"], wall["frame"]) == (-1, -1, -1)


def driven():
    """Return a cart that an input pushes."""
    x, push, N, O = *dynamicsymbols("x push"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("cart", O.locatenew("P", x * N.x), symbols("m", positive=True)))
    scene.add_inputs(push)
    scene.add_loads((scene.bodies[0].masscenter, push * N.x))
    return scene


def test_inputs_and_values_of_sliders(tmp_path):
    need_pages()
    model = da.compile_model(driven(), outputs=["x_ddot"])
    path = model.export(
        tmp_path / "cart.html", "page", initial={"x": 0, "x_dot": 1}, parameters={"m": 2}, inputs={"push": 1}
    )
    _, found = run_of(path, [0, 2.0], {"push": 3.0, "x_dot": -1.0})
    assert found["x"][1] == pytest.approx(-2 + 0.75 * 4, rel=1e-12) and found["x_ddot"][0] == pytest.approx(1.5)


def test_a_start_that_contradicts_a_constraint_says_so(tmp_path):
    need_pages()
    x, y = dynamicsymbols("x y")
    m, l, g = symbols("m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bob", O.locatenew("P", x * N.x + y * N.y), m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(x**2 + y**2 - l**2)
    model = da.compile_model(scene, formulation="projected")
    start = {"x": float(sin(0.5)), "y": -float(cos(0.5)), "x_dot": 0, "y_dot": 0}
    path = model.export(tmp_path / "a.html", "page", initial=start, parameters={"m": 1, "l": 1, "g": 9.81})
    told, found = run_of(path, [0, 1], {"l": 1.2})
    assert told["status"] == int(Status.INITIAL_STATE) and not len(found["x"])
    assert told["why"][1].startswith("positions: holonomic constraint 1")
    assert run_of(path, [0, 1], {"m": -1})[0]["status"] == int(Status.ASSUMPTION)


@pytest.fixture
def nothing_compiled(monkeypatch):
    """Make pages without their simulators."""
    monkeypatch.setattr(page, "web_assembly", lambda texts, **options: b"")


@pytest.fixture(scope="module")
def sleigh():
    return da.compile_model(da.scenes.chaplygin_sleigh())


def exported(model, path, **options):
    return model.export(path, "page", **{"initial": SLEIGH, "parameters": NUMBERS, **options})


def test_sliders_are_those_that_are_asked_for(tmp_path, sleigh, nothing_compiled):
    all_of_them = parts(exported(sleigh, tmp_path / "a.html"))[0]["given"]
    ends = {item["name"]: item["ends"] for item in all_of_them}
    assert list(ends) == ["x", "y", "theta", "x_dot", "theta_dot", "I_C", "b", "m"]
    assert ends["b"] == pytest.approx([0.03, 0.6]) and ends["theta"] == [-3.1416, 3.1416] and ends["x"] == [-1, 1]
    x, b = dynamicsymbols("x"), symbols("b", positive=True)
    asked = parts(exported(sleigh, tmp_path / "a.html", sliders={b: (0.1, 0.4), x.diff(): (-1, 2)}))[0]["given"]
    assert {item["name"]: (item["ends"], item["place"]) for item in asked if "ends" in item} == {
        "b": ([0.1, 0.4], 0),
        "x_dot": ([-1.0, 2.0], 1),
    }
    assert [item["value"] for item in asked] == [item["value"] for item in all_of_them]


def test_sliders_that_are_wrong(tmp_path, sleigh, nothing_compiled):
    path = tmp_path / "a.html"
    with pytest.raises(UnknownNameError, match="slider 'mass'"):
        exported(sleigh, path, sliders={"mass": (0, 1)})
    for ends in ((1, 0), (0, float("inf")), (1,), 3, ("a", "b")):
        with pytest.raises(OptionError, match=r"slider 'm' needs two finite numbers \(low, high\)"):
            exported(sleigh, path, sliders={"m": ends})
    with pytest.raises(OptionError, match="must be a mapping"):
        exported(sleigh, path, sliders=["m"])
    with pytest.raises(OptionError, match="sliders are those of the kind 'page'"):
        sleigh.export(tmp_path / "c", sliders={"m": (0, 1)})
    assert list(tmp_path.iterdir()) == []


def test_a_page_takes_the_place_of_a_page_alone(tmp_path, sleigh, nothing_compiled):
    path = exported(sleigh, tmp_path / "a.html")
    assert exported(sleigh, path) == path
    path.write_text("<html>mine</html>")
    with pytest.raises(OptionError, match="was not written by an export"):
        exported(sleigh, path)
    assert path.read_text() == "<html>mine</html>"
    with pytest.raises(OptionError, match=r"ends in '\.html'"):
        exported(sleigh, tmp_path / "a")


def test_pages_need_a_compiler_and_all_numbers(tmp_path, sleigh, monkeypatch):
    with pytest.raises(CapabilityError, match=r"a page needs a start value for each.*Missing: I_C, b, m"):
        sleigh.export(tmp_path / "a.html", "page", initial=SLEIGH)
    monkeypatch.setattr(compilers, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r'pip install "dalembert\[export\]"'):
        exported(sleigh, tmp_path / "a.html")


def test_a_compiler_that_fails_is_told_of(monkeypatch):
    monkeypatch.setattr(compilers, "find_spec", lambda name: name)
    monkeypatch.setattr(compilers, "_ZIG", ("false",))
    with pytest.raises(OptionError, match="cannot compile the export"):
        compilers.web_assembly({"a.c": "int a;"}, ["b"], small=False)


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ({"cart": da.Sphere(-1)}, "no positive length"),
        ({"card": da.Sphere(1)}, "no body is called so"),
        ({"cart": da.Sphere(symbols("r"))}, "no positive length"),
    ],
)
def test_shapes_that_are_wrong(shapes, message):
    scene = driven()
    scene.add_shapes(shapes)
    layout = da.compile_model(driven()).layout
    with pytest.raises(OptionError, match=message):
        page.picture_of(scene, {"m": 1.0}, layout)
