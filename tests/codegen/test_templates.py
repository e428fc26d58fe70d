"""Templates: each uses exactly what Python gives it, and the structure of the text stands in the template."""

import functools
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from unittest import mock

import jinja2
import jinja2.meta
import jinja2.nodes
import pytest
from sympy import exp, log, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from codegen.llvm_texts import FURTHER_TEXTS, TEXTS
from codegen.programs import PROGRAMS
from dalembert.codegen import rendering
from dalembert.codegen.c import contact_simulator, simulator
from dalembert.codegen.cache import ENVIRONMENT_VARIABLE
from dalembert.codegen.llvm import target as lane_types
from dalembert.codegen.llvm.assembly import assembly
from dalembert.codegen.llvm.definitions import with_definitions
from dalembert.codegen.llvm.foreign_batch import BatchSizes, Interface, batch_arguments, batch_assembly
from dalembert.codegen.numba import texts
from dalembert.codegen.numba.texts import table_definitions
from dalembert.codegen.printers import JAX, NUMPY
from dalembert.codegen.rendering import program_variables, render, template_directory
from dalembert.export import fmu, page, wheel
from dalembert.export.jax_file import jax_text
from dalembert.export.numba_file import numba_text
from dalembert.export.simulator import c_source
from dalembert.ir.kernel import Assignment, Kernel, Load
from dalembert.lanes.sweep_arguments import SweepKernels
from dalembert.loops.foreign_batch_loop import BatchCode
from dalembert.methods.tableaus import TABLEAUS
from dalembert.subset.arguments import OwnedAddress
from dalembert.transforms.taylor.recurrences import recurrences
from table_cases import spring

FOLDER = template_directory()
ALL = sorted(path.relative_to(FOLDER).as_posix() for path in FOLDER.rglob("*") if path.is_file())
MODULES = {"numpy/module.py.j2": NUMPY, "jax/module.py.j2": JAX}


def code_at(*addresses):
    """Return addresses of code that is not called."""
    return tuple(OwnedAddress(address, None) for address in addresses)


def render_everything():
    """Render every template, with what the library gives it."""
    for program in (make() for make in PROGRAMS.values()):
        for template, printer in MODULES.items():
            render(template, program_variables(program, printer))
        texts.module(program)
        render_jax(program)
    render_numba(PROGRAMS["oscillator"]().kernel("rhs"))
    render_tables()
    made, unit = made_once(contact_simulator.simulator_of), made_once(fmu.unit_simulator)
    with (
        mock.patch.object(contact_simulator, "simulator_of", made),
        mock.patch.object(page, "simulator_of", made),
        mock.patch.object(fmu, "unit_simulator", unit),
    ):
        render_c()
    render_batch_handlers()
    for write in (*TEXTS.values(), *FURTHER_TEXTS):
        write()
    with mock.patch.object(lane_types, "_LARGEST_FRAME", 0):
        TEXTS["pendulum_order_loop"]()
        TEXTS["pendulum_series_loop"]()
        TEXTS["pendulum_pieces"]()


def made_once(make):
    """Return a function that makes one simulator of a source, however many kinds of exports have it."""
    made = {}

    def simulator_of(source):
        if id(source) not in made:
            made[id(source)] = source, make(source)
        return made[id(source)][1]

    return simulator_of


def render_batch_handlers():
    """Render handlers of batches and of single runs, with records and without."""
    kernels, interface = SweepKernels(*code_at(1, 2, 3, 4, 0, 0, 5, 6)), Interface((0, 3), {})
    for lanes in (1, 4):
        batch = batch_arguments(kernels, BatchSizes(lanes, 2, 3, 4, 4), interface, BatchCode(*code_at(1, 2, 3), 4))
        for recorded in (True, False):
            batch_assembly(batch, recorded, interface, 7)


def render_numba(rhs):
    """Render the functions for loops: kernels of several cases, steps and attempts with loops and calls."""
    texts.kernel("kernel", rhs, 8)
    texts.entries([("kernel", "compiled")])
    with mock.patch.multiple(texts, _LARGEST_STRAIGHT=0, _LARGEST_INLINED=0):
        for dense in (True, False):
            texts.taylor_step("step", recurrences(rhs), 8, dense=dense)
            texts.attempt(rhs, TABLEAUS[0], dense=dense, carried=True)


def render_tables():
    """Render what modules use of tables."""
    key = float(spring("linear").curve.table.key)
    body = (Assignment("i", "piece", ("x", key)), Assignment("f", "entry", ("i", key, 0.0)))
    kernel = Kernel("k", ("y",), (Load("x", "y", 0),), body, ("f",))
    for lanes in (1, 4):
        with_definitions(assembly([("k", kernel)], lanes))
    table_definitions(texts.kernel("k", kernel))


def render_c():
    """Render simulators in C and units, by both kinds of steps, of a scene with inputs, outputs and a table."""
    z, u, N, O = *dynamicsymbols("z u"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[z])
    scene.add_bodies(Particle("cart", O.locatenew("P", z * N.x), symbols("m", positive=True)))
    scene.add_inputs(u)
    loss = exp(-(z**2)) * log(1 + z**2)
    spring = da.table(z, [-9, -1, 1, 9], [1, 0, 0, -2], kind="cubic")
    scene.add_loads((scene.bodies[0].masscenter, (u - spring - loss) * N.x))
    model = da.compile_model(scene, outputs=["z_ddot"])
    with mock.patch.object(simulator, "LARGEST_STRAIGHT", 0):
        for method in ("taylor", "dop853"):
            given = {"z": 0.0, "z_dot": 1.0}, {"z": 0.0, "z_dot": 1.0, "m": 2.0}
            source = c_source(model, *given, method, (1e-8, 1e-10), (0.0, 1.0))
            assert {*contact_simulator.c_files(source)} == {"cart.c", "cart.h", "main.c", "Makefile", "README.md"}
            render_units(source)
            if method == "taylor":
                numba_text(source)
            render_files(source, scene)
    sleigh = da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["Y"])
    jax_text(c_source(sleigh, None, {}, "dop853", (1e-8, 1e-10), (0.0, 1.0)))
    for precision in ("double", "single"):
        contact_simulator.c_files(c_source(sleigh, None, {}, "rk4", (1e-8, 1e-10), (0.0, 1.0), 0.01, precision))
    for method, step in (("dop853", None), ("rk4", 0.01)):
        source = c_source(in_angles(), None, {}, method, (1e-8, 1e-10), (0.0, 1.0), step)
        assert source.locking
        contact_simulator.c_files(source)
    render_contacts()
    render_controllers()
    render_events()


def held():
    """Return a cart whose force a sampled law holds, and an event of it."""
    z, u, N, O = *dynamicsymbols("z u"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[z])
    scene.add_bodies(Particle("cart", O.locatenew("cart", z * N.x), symbols("m", positive=True)))
    scene.add_inputs(u)
    scene.add_loads((scene.bodies[0].masscenter, u * N.x))
    scene.add_controllers(da.Controller("spring", period=0.1, inputs={u: -z}))
    return da.compile_model(scene), da.Event(z - 1, apply={z.diff(): 0})


def render_controllers():
    """Render simulators and units with a sampled law, alone and beside an event."""
    (model, event), numbers = held(), {"z": 0.0, "z_dot": 1.0, "m": 2.0}
    for method, events in (("taylor", ()), ("dop853", ()), ("dop853", (event,))):
        given = model, {"z": 0.0, "z_dot": 1.0}, numbers, method, (1e-8, 1e-10), (0.0, 1.0)
        contact_simulator.c_files(c_source(*given, events=events))
        render_units(c_source(*given, events=events, continued=True))


def render_units(source):
    """Render a unit in both versions, without its binary."""
    for version in ("2.0", "3.0"):
        fmu.fmu_files(source, platforms=[], version=version)


def render_events():
    """Render simulators with events: beside angles that lock, inputs, contacts and controllers, in all kinds."""
    angles, turned = in_angles(), da.Event(dynamicsymbols("a") - 1)
    numbers = dict.fromkeys((*angles.layout.variables, *angles.layout.parameters), 1.0)
    for continued in (False, True):
        given = angles, None, numbers, "taylor", (1e-8, 1e-10), (0.0, 1.0)
        source = c_source(*given, events=(turned,), continued=continued)
        (render_units if continued else contact_simulator.c_files)(source)
    scene, (x, u) = pushed(), dynamicsymbols("x u")
    block = da.compile_model(scene)
    numbers = {"x": 0.0, "x_dot": 1.0, "y": 0.0, "y_dot": 0.0, "m": 2.0, "mu": 0.1, "u": 1.0}
    source = c_source(block, None, numbers, "dop853", (1e-8, 1e-10), (0.0, 1.0), events=(da.Event(x - 1),))
    render_files(source, scene)
    scene.add_controllers(da.Controller("spring", period=0.1, inputs={u: -x}))
    law = da.compile_model(scene)
    contact_simulator.c_files(c_source(law, None, {}, "dop853", (1e-8, 1e-10), (0.0, 1.0)))


def render_files(source, scene):
    """Render a simulator as a folder, a package and a page."""
    contact_simulator.c_files(source)
    nothing = {"shared_library": lambda compiler, texts: b"", "c_compiler": lambda: ["cc"]}
    with mock.patch.multiple(wheel, **nothing):
        wheel.wheel_files(source)
    with mock.patch.object(page, "web_assembly", lambda texts, **options: b""):
        page.page_text(source, source, scene, None)


def in_angles():
    """Return a body about a fixed point in Euler angles, which lock."""
    angles, N, O = dynamicsymbols("a b c"), ReferenceFrame("N"), Point("O")
    frame = ReferenceFrame("B")
    frame.orient_body_fixed(N, angles, "ZXZ")
    scene = da.Scene("body", frame=N, origin=O, coordinates=angles)
    scene.add_bodies(RigidBody("body", O, frame, symbols("m"), (inertia(frame, *symbols("A B C")), O)))
    return da.compile_model(scene)


def render_contacts():
    """Render scenes with contacts: a simulator with inputs and outputs, a unit with outputs, a page without."""
    model = da.compile_model(pushed(), outputs=["F"])
    contact_simulator.c_files(c_source(model, None, {}, "dop853", (1e-8, 1e-10), (0.0, 1.0)))
    scene = pushed(by_input=False)
    numbers = dict.fromkeys(("x", "x_dot", "y", "y_dot", "m", "mu"), 1.0)
    model = da.compile_model(scene, outputs=["F"])
    render_units(c_source(model, None, numbers, "dop853", (1e-8, 1e-10), (0.0, 1.0), continued=True))
    render_files(c_source(da.compile_model(scene), None, numbers, "dop853", (1e-8, 1e-10), (0.0, 1.0)), scene)


def pushed(by_input=True):
    """Return a block on a rough table that an input pushes, or a spring."""
    x, y, u, N, O = *dynamicsymbols("x y u"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x, y])
    B = O.locatenew("B", x * N.x + y * N.y)
    scene.add_bodies(Particle("block", B, symbols("m")))
    if by_input:
        scene.add_inputs(u)
    scene.add_loads((B, (u if by_input else 3 - x) * N.x - 9 * N.y))
    normal, friction = da.unknowns("R F")
    scene.add_joints(da.Joint("table", body="block", at=B, force=normal * N.y + friction * N.x))
    scene.add_holonomic_constraints(y)
    scene.add_friction(da.CoulombFriction(normal, friction, mu=symbols("mu")))
    return scene


def render_jax(program):
    try:
        from dalembert.jax.modules import compile_kernel
    except ImportError:
        pytest.skip("extra not installed")
    for kernel in program:
        compile_kernel(kernel)


@functools.cache
def variables_given():
    """Return what each template was given, once a call: rendered by the first test, in no order that tests have."""
    calls = {}
    rendered = rendering._rendered

    def record(template, variables):
        calls.setdefault(template, []).append(variables)
        return rendered(template, variables)

    with mock.patch.object(rendering, "_rendered", record):
        render_everything()
    return calls


def source_of(template):
    return (FOLDER / template).read_text(encoding="utf-8")


@functools.cache
def syntax_of(template):
    return jinja2.Environment().parse(source_of(template))


@functools.cache
def imported(template):
    """Return the templates whose macros a template uses, directly or not."""
    direct = set(jinja2.meta.find_referenced_templates(syntax_of(template)))
    return direct.union(*map(imported, direct))


MACROS = set().union(*map(imported, ALL))
templates = pytest.mark.parametrize("template", ALL)
rendered = pytest.mark.parametrize("template", sorted(set(ALL) - MACROS))


def test_every_template_is_rendered_or_imported_by_one_that_is():
    assert set(variables_given()) == set(ALL) - MACROS
    assert set().union(*map(imported, variables_given())) == MACROS


@templates
def test_template_uses_exactly_the_variables_it_is_given(template):
    used = jinja2.meta.find_undeclared_variables(syntax_of(template))
    calls = variables_given().get(template, [{}])  # a template of macros uses nothing but their arguments
    assert [set(variables) for variables in calls] == [used] * len(calls)


@rendered
def test_template_uses_exactly_the_fields_of_its_variables(template):
    syntax = [syntax_of(name) for name in (template, *imported(template))]
    fields = [node for tree in syntax for node in tree.find_all(jinja2.nodes.Getattr)]
    used = {node.attr for node in fields if getattr(node.node, "name", "") != "loop"}  # what Jinja knows of its loops
    given = [set().union(*map(fields_of, variables.values())) for variables in variables_given()[template]]
    assert given == [used] * len(given)


def fields_of(value):
    """Return the names of the fields of a variable."""
    if isinstance(value, Mapping):
        return set(value).union(*map(fields_of, value.values()))
    if isinstance(value, (list, tuple)):
        return set().union(*map(fields_of, value))
    return set()


STRUCTURE = re.compile(r"\n|:$|^(for|while|if|else|def|return|import|from|define|declare|br|ret)\b|= (phi|alloca)\b")


def strings_of(value):
    """Yield the strings in a variable."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        yield from (text for item in value.values() for text in strings_of(item))
    elif isinstance(value, (list, tuple)):
        yield from (text for item in value for text in strings_of(item))
    else:
        assert isinstance(value, int | bool)


@rendered
def test_no_variable_holds_structure(template):
    """No line break, label, loop, branch, signature, declaration, phi, allocation or return."""
    for variables in variables_given()[template]:
        assert [text for text in strings_of(variables) if STRUCTURE.search(text)] == []


@templates
def test_templates_hold_loops_and_choices_but_no_computation(template):
    source = source_of(template)
    tags = {tag.split()[0] for tag in re.findall(r"{%-?\s*(.*?)\s*-?%}", source)}
    assert tags <= {"for", "endfor", "if", "else", "endif", "macro", "endmacro", "from"}
    assert not re.search(r"{{[^}]*[-+*/|]", source)


@rendered
def test_a_missing_variable_is_an_error_that_names_it(template):
    for name in variables_given()[template][0]:
        rest = {other: value for other, value in variables_given()[template][0].items() if other != name}
        with pytest.raises(jinja2.UndefinedError, match=f"'{name}' is undefined"):
            render(template, rest)


RENDER = """
import os, pathlib, sys
from codegen.llvm_texts import TEXTS
import jinja2

def run():
    if child := os.fork():
        assert os.waitpid(child, 0)[1] == 0
        return
    compiled, original = [], jinja2.Environment.compile
    jinja2.Environment.compile = lambda self, *args, **kwargs: compiled.append(args) or original(self, *args, **kwargs)
    print(repr(TEXTS["check_inputs"]()), len(compiled), flush=True)
    os._exit(0)

run()
run()
(kept,) = pathlib.Path(sys.argv[1], "templates").iterdir()
kept.write_bytes(kept.read_bytes()[:-1])
run()
run()
"""


def test_compiled_templates_are_kept_and_believed_only_whole(tmp_path):
    """By four processes, which have imported what they need from one that renders nothing."""
    environment = {**os.environ, ENVIRONMENT_VARIABLE: str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    code = [sys.executable, "-c", RENDER, tmp_path]
    done = subprocess.run(code, capture_output=True, text=True, check=True, env=environment)
    texts, compiled = zip(*(line.rsplit(" ", 1) for line in done.stdout.splitlines()), strict=True)
    assert len(set(texts)) == 1 and "define" in texts[0]
    assert compiled == ("1", "0", "1", "0")
    assert done.stderr.count("was damaged and is rebuilt") == 1
