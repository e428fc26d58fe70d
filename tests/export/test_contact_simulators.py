"""Simulators in C of scenes whose contacts change, compiled with warnings as errors, and run beside `simulate`."""

from functools import cache

import numpy as np
import pytest
from sympy import Piecewise, cos, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from codegen.c_programs import OPTIMISED, SANITIZED, built, compiler, output, same_bits
from dalembert.contacts.equations.contact_laws import STATES
from dalembert.errors import CapabilityError
from export.pages import need_pages, parts, run_of
from hard_cases.contacts import contact_motion

TOLERANCES = {"rtol": 1e-10, "atol": 1e-12}

MODES = """
#include "{0}.h"
#include <stdio.h>
#include <stdlib.h>
int main(int argc, char **argv)
{{
    static {0}_run run, copy;
    double values[64], state[64], same[64];
    int i, last = -1;
    for (i = 2; i < argc; i++) {{
        values[i - 2] = atof(argv[i]);
    }}
    {0}_start(&run, 0.0, atof(argv[1]), values, values + {1}_INITIAL, 0.0, 0);
    while (run.status == {1}_RUNNING) {{
        copy = run;
        {0}_step(&run);
        {0}_step(&copy);
        if ({0}_time(&run) != {0}_time(&copy) || {0}_contact(&run, 0) != {0}_contact(&copy, 0)) {{
            return 3;
        }}
        if (last != {0}_contact(&run, 0)) {{
            last = (int){0}_contact(&run, 0);
            printf("%d\\n", last);
        }}
    }}
    if ({0}_at(&run, {0}_time(&run), state) != {1}_SUCCESS || {0}_at(&copy, {0}_time(&copy), same) != {1}_SUCCESS) {{
        return 4;
    }}
    for (i = 0; i < {1}_STATES; i++) {{
        if (state[i] != same[i]) {{
            return 5;
        }}
    }}
    return {0}_contact(&run, {1}_CONTACTS_END) == -1 ? 0 : 6;
}}
"""
"""A program that prints what the first contact does, whenever that changes, and runs a copy beside every step."""


def exported(folder, model, initial, parameters, end, *options, **given):
    """Export a model, and compile its example; return the program and the prefix of its names."""
    compiler()
    path = model.export(folder / "export", initial=initial, parameters=parameters, t_span=(0, end), **given)
    (header,) = path.glob("*.h")
    return built(path, ["main.c", f"{header.stem}.c"], *options), header.stem


def rows(text):
    """Return the columns of comma-separated values by name."""
    head, *lines = text.splitlines()
    values = np.array([[float(number) for number in line.split(",")] for line in lines])
    return dict(zip(head.split(","), values.T, strict=True))


@pytest.fixture(scope="module")
def program_of(tmp_path_factory):
    """Return a function of the name of a motion and a method, of the model and the program of its example."""

    @cache
    def program(name, method):
        case = contact_motion(name).motion
        model, end = case.compile("auto"), end_of(case, method)
        folder, given = tmp_path_factory.mktemp("motion"), {"method": method, **TOLERANCES}
        options = OPTIMISED if name == "block on a belt" else ()
        return model, exported(folder, model, case.initial, case.parameters, end, *options, **given)[0]

    return program


def end_of(case, method):
    """Return where a run of a motion ends."""
    return min(case.times()[-1], 20.0 if method != "radau" else 0.6)


@pytest.mark.parametrize(
    ("name", "method"),
    [
        ("bouncing ball", "auto"),
        ("block on a belt", "auto"),
        ("plate through the upright position", "auto"),
        ("plate pushed and pulled", "dop853"),
        ("rod that falls on the ground", "radau"),
    ],
)
def test_motions_in_phases_are_those_of_simulate(program_of, name, method):
    """Impacts, stick and slip, contacts that open; the last state to the last bit where both fuse or do not.

    Sanitizers find nothing in the ball with events (`test_events_beside_contacts`).
    """
    case, (model, program) = contact_motion(name).motion, program_of(name, method)
    end, given = end_of(case, method), {"method": method, **TOLERANCES}
    found = rows(output(program, end, 41))
    run = model.simulate((0, end), case.initial, case.parameters, t_eval=found["t"], **given)
    assert len(run.phases) > 1
    for key in found.keys() - {"t"}:
        np.testing.assert_allclose(found[key], run[key], rtol=1e-11, atol=1e-11, err_msg=key)
    if same_bits():
        last = model.sweep((0, end), case.initial, case.parameters, threads=1, **given)
        for key in model.layout.variables:
            assert abs(found[key][-1] - last[key][0]) <= 2e-16 * abs(last[key][0])


@cache
def ball():
    """Return a ball over a floor, its start and its parameters."""
    case = contact_motion("bouncing ball").motion
    return da.compile_model(da.scenes.bouncing_ball()), case.initial, case.parameters


def test_a_ball_on_a_line_rests_and_is_lifted(tmp_path):
    """While it rests, nothing moves, and there is no state."""
    x, (m, g, e, A) = dynamicsymbols("x"), symbols("m g e A", positive=True)
    N, O, R = ReferenceFrame("N"), Point("O"), da.unknowns("R")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("ball", P, m))
    scene.add_loads((P, (A * cos(2 * dynamicsymbols._t) - m * g) * N.x))
    scene.add_joints(da.Joint("floor", body="ball", at=P, force=R * N.x))
    scene.add_contacts(da.UnilateralContact(R, x, name="floor", restitution=e))
    model, start, numbers = da.compile_model(scene), {"x": 1, "x_dot": 0}, {"m": 1, "g": 9.81, "e": 0.5, "A": 12}
    program, _ = exported(tmp_path, model, start, numbers, 6, **TOLERANCES)
    found = rows(output(program))
    run = model.simulate((0, 6), start, numbers, t_eval=found["t"], **TOLERANCES)
    assert {phase.modes["floor"] for phase in run.phases} == {"open", "closed"} and run["x"].max() > 0.8
    for name in ("x", "x_dot"):
        np.testing.assert_allclose(found[name], run[name], rtol=1e-9, atol=1e-9)


def test_what_contacts_do_is_told_and_a_copy_is_the_same_run(tmp_path):
    case = contact_motion("block on a belt").motion
    model, end = case.compile("auto"), 10.0
    compiler()
    path = model.export(tmp_path / "export", initial=case.initial, **TOLERANCES)
    name = next(path.glob("*.h")).stem
    upper = name.upper()
    (path / "modes.c").write_text(MODES.format(name, upper).replace(f"{upper}_CONTACTS_END", "1"))
    known = {**model.read_initial(case.initial), **model.read_parameters(case.parameters)}
    given = [repr(float(known[key])) for key in (*sorted(case.initial, key=model.layout.variables.index),)]
    given += [repr(float(known[key])) for key in model.layout.parameters]
    text = output(built(path, ["modes.c", f"{name}.c"]), end, *given)
    run = model.simulate((0, end), case.initial, case.parameters, **TOLERANCES)
    contact = model.contacts[0]
    assert [STATES[int(line)] for line in text.split()] == [phase.modes[contact] for phase in run.phases]


def test_a_state_at_an_impact_is_that_behind_it(program_of):
    """At the time itself, as `simulate` records it."""
    _, initial, parameters = ball()
    model, program = program_of("bouncing ball", "auto")
    first = model.simulate((0, 2), initial, parameters, **TOLERANCES).phases[1].t0
    found = rows(output(program, repr(2 * first), 3))
    run = model.simulate((0, 2 * first), initial, parameters, t_eval=found["t"], **TOLERANCES)
    np.testing.assert_allclose(found["y_dot"], run["y_dot"], rtol=1e-12)
    assert found["t"][1] == first and found["y_dot"][1] > 0.0


def test_starts_that_contacts_forbid_are_refused(program_of):
    _, initial, parameters = ball()
    model, program = program_of("bouncing ball", "auto")
    restitution = next(name for name in parameters if name.startswith("e"))
    order = [*sorted(initial, key=model.layout.variables.index), *model.layout.parameters]
    for wrong in ({"y": -0.1}, {restitution: 1.5}):
        values = {**initial, **parameters, **wrong}
        assert "status 5: " in output(program, 2, 3, *(repr(float(values[name])) for name in order), status=1)


def test_a_page_moves_as_in_simulate_and_shows_what_contacts_do(tmp_path):
    need_pages()
    case = contact_motion("block on a belt").motion
    model, end = case.compile("auto"), 10.0
    given = {"initial": case.initial, "parameters": case.parameters}
    path = model.export(tmp_path / "page.html", "page", t_span=(0, end), **given)
    times = np.linspace(0, end, 21)
    printed, found = run_of(path, times)
    run = model.simulate((0, end), case.initial, case.parameters, t_eval=times)
    assert printed["status"] == 0 and path.stat().st_size < 500_000
    for key in model.layout.variables:
        np.testing.assert_allclose(found[key], run[key], rtol=1e-11, atol=1e-11, err_msg=key)
    np.testing.assert_allclose(found["kinetic"] + found["potential"], run["energy"], rtol=1e-11)
    contact = model.contacts[0]
    shown = next(name for name in parts(path)[0]["outputs"] if name.startswith(f"{contact}: "))
    middles = [run.phases[np.searchsorted([p.t0 for p in run.phases], t) - 1].modes[contact] for t in times[1:]]
    assert [STATES[int(value)] for value in found[shown][1:]] == middles


def falling_rod():
    """Return a rod that falls onto a rough floor with both ends."""
    (x, y, a), (m, g, mu) = dynamicsymbols("x y a"), symbols("m g mu", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    R, G = N.orientnew("R", "Axis", (a, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene = da.Scene("falling_rod", frame=N, origin=O, coordinates=[x, y, a])
    scene.add_bodies(RigidBody("rod", G, R, m, (inertia(R, 0, 0, m / 12), G)))
    scene.apply_uniform_gravity(-g * N.y)
    ends = {name: G.locatenew(name, side * R.x / 2) for name, side in (("left", -1), ("right", 1))}
    about = {"body": "rod", "plane": (O, N.y), "friction": mu, "restitution": 0.4}
    scene.add_contacts(*(da.PointPlane(name, point=point, **about) for name, point in ends.items()))
    return scene


def test_two_rough_contacts_that_open_fit_in_a_page(tmp_path):
    need_pages()
    model, times = da.compile_model(falling_rod()), np.linspace(0, 1.0, 21)
    initial = {"x": 0, "y": 0.5, "a": 0.2, "x_dot": 1, "y_dot": 0, "a_dot": 0}
    given = {"initial": initial, "parameters": {"m": 1, "g": 9.81, "mu": 0.3}, "rtol": 1e-9}
    path = model.export(tmp_path / "page.html", "page", t_span=(0, 1.0), **given)
    assert path.stat().st_size < 500_000
    printed, found = run_of(path, times)
    run = model.simulate((0, 1.0), t_eval=times, **given)
    assert printed["status"] == run.status == 0 and len(run.phases) > 2
    for key in model.layout.variables:
        np.testing.assert_allclose(found[key], run[key], rtol=1e-9, atol=1e-9, err_msg=key)


# -- what is not exported -------------------------------------------------------------------------


def pile(count):
    """Return balls over a floor, each of which may slip, stick and lift off."""
    q, m = dynamicsymbols(f"q0:{2 * count}"), symbols("m", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pile", frame=N, origin=O, coordinates=list(q))
    for i in range(count):
        place = O.locatenew(f"P{i}", q[2 * i] * N.x + q[2 * i + 1] * N.y)
        scene.add_bodies(Particle(f"ball {i}", place, m))
        normal, friction = da.unknowns(f"N{i} F{i}")
        scene.add_joints(da.Joint(f"floor {i}", body=f"ball {i}", at=place, force=normal * N.y + friction * N.x))
        scene.add_contacts(da.UnilateralContact(normal, gap=q[2 * i + 1], name=f"floor {i}"))
        scene.add_friction(da.CoulombFriction(normal, friction, mu=symbols("mu"), name=f"floor {i}"))
    return scene


def test_more_modes_than_exports_carry_are_counted(tmp_path):
    with pytest.raises(CapabilityError, match=r"have 27 combinations .* up to 12.*fewer contacts"):
        da.compile_model(pile(3)).export(tmp_path / "here")


def block(push=None, force=0):
    """Return a block on a rough table, pushed by an input or a force."""
    x, y, m, mu = *dynamicsymbols("x y"), *symbols("m mu", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    B = O.locatenew("B", x * N.x + y * N.y)
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("block", B, m))
    if push is not None:
        scene.add_inputs(push)
    scene.add_loads((B, (force + (push or 0)) * N.x - 9 * m * N.y))
    normal, friction = da.unknowns("R F")
    scene.add_joints(da.Joint("table", body="block", at=B, force=normal * N.y + friction * N.x))
    scene.add_holonomic_constraints(y)
    scene.add_friction(da.CoulombFriction(normal, friction, mu=mu, name="table"))
    return scene, x


INPUTS = """
#include "block.h"
#include <stdio.h>
#include <stdlib.h>
int main(int argc, char **argv)
{
    static const double forces[] = {2.0, 5.0, 3.0, -4.5, 0.0, -9.0, 4.4};
    static const double slopes[] = {0.0, -1.0, 0.0, 3.0, 0.0, 0.0, 0.0};
    const double initial[] = {0.0, 0.0}, parameters[] = {1.0, 0.5};
    const double first = atof(argv[argc - 1]);
    double state[BLOCK_STATES], end;
    block_run run;
    int32_t k, status = block_start(&run, 0.0, first, initial, parameters, 0.0, 0);
    for (k = 0; k < 7 && status <= BLOCK_SUCCESS; k++) {
        block_set_input(&run, block_input_u, forces[k], slopes[k]);
        while (block_step(&run) == BLOCK_RUNNING) {
            if (first > 1.0 && block_time(&run) >= 0.3 * (k + 1)) {
                break;
            }
        }
        do { /* a change at the end of a step takes the next one */
            end = block_time(&run);
            status = block_at(&run, end, state);
        } while (end != block_time(&run));
        printf("%a %a %a %d\\n", end, state[0], state[2], (int)block_contact(&run, 0));
        block_continue(&run, block_time(&run) + 0.3);
    }
    return status > BLOCK_SUCCESS;
}
"""
"""A program that sets an input at times, and prints them, the state there, and what the contact has done until then.

Its argument is the end of the first run; where that is late, the input is set between steps.
"""


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    """Return the model of a block that is pushed, its start, its parameters, and `INPUTS` by a method."""
    compiler()
    model = da.compile_model(block(push=dynamicsymbols("u"))[0])
    initial, numbers = {"x": 0, "x_dot": 0}, {"m": 1, "mu": 0.5}

    @cache
    def program(method):
        folder = tmp_path_factory.mktemp(method)
        path = model.export(folder / "export", initial=initial, method=method, **TOLERANCES)
        (path / "inputs.c").write_text(INPUTS)
        return built(path, ["inputs.c", "block.c"], *SANITIZED)

    return model, initial, numbers, program


@pytest.mark.filterwarnings("ignore:no coordinate or rate")  # of the first step of radau alone
@pytest.mark.parametrize("between", ["0.3", "3.0"])
@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_inputs_are_set_at_the_ends_of_runs_and_between_steps(pushed, method, between):
    """The contact slips and sticks at once where the input jumps, as in runs of `simulate` from there."""
    model, initial, numbers, program = pushed
    lines = output(program(method), between).splitlines()
    table = np.array([[float.fromhex(item) for item in line.split()] for line in lines])
    forces, slopes, begin, state = (
        [2.0, 5.0, 3.0, -4.5, 0.0, -9.0, 4.4],
        [0.0, -1.0, 0.0, 3.0, 0.0, 0.0, 0.0],
        0.0,
        initial,
    )
    for force, slope, (end, x, rate, did) in zip(forces, slopes, table, strict=True):
        pushed = {"u": da.samples([begin, end], [force, force + slope * (end - begin)], kind="linear")}
        run = model.simulate((begin, end), state, numbers, inputs=pushed, **TOLERANCES)
        assert (x, rate) == pytest.approx((run["x"][-1], run["x_dot"][-1]), rel=1e-9, abs=2e-9)
        assert STATES[int(did)] == run.phases[-1].modes["table"]
        begin, state = end, {"x": x, "x_dot": rate}
    assert {STATES[int(did)] for did in table[:, 3]} == {"stick", "slip"}


def test_breaks_are_refused(tmp_path):
    scene, _ = block(force=Piecewise((1, dynamicsymbols._t < 1), (0, True)))
    with pytest.raises(CapabilityError, match=r"kinks or jumps.*contacts that change do not"):
        da.compile_model(scene).export(tmp_path / "here")


def test_one_mode_is_exported_by_itself(tmp_path):
    model, initial, _ = ball()
    mode = model.mode(**{model.contacts[0]: "open"})
    assert mode.export(tmp_path / "one mode", initial=initial).is_dir()


def test_smooth_forces_of_time_are_carried(tmp_path):
    scene, _ = block(force=9 * cos(3 * dynamicsymbols._t))
    model = da.compile_model(scene)
    initial, parameters = {"x": 0, "x_dot": 0}, {"m": 1, "mu": 0.4}
    program, _ = exported(tmp_path, model, initial, parameters, 3, **TOLERANCES)
    found = rows(output(program, 3, 16))
    run = model.simulate((0, 3), initial, parameters, t_eval=found["t"], **TOLERANCES)
    np.testing.assert_allclose(found["x"], run["x"], atol=1e-12)
