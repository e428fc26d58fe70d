"""The text form of kernels and programs is exact: it parses back to what was printed, or says what it expected."""

import math
from dataclasses import replace
from functools import cache
from textwrap import dedent

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import FormulationError, ProgramTextError
from dalembert.ir.conditions import NARROW, WHOLE, ZERO, Conditions
from dalembert.ir.kernel import Assignment, Kernel, Load
from dalembert.ir.ops import ALL_OPERATIONS, CALL_OPERATIONS, TABLE_OPERATIONS
from dalembert.ir.program import Layout, Program
from dalembert.lowering.programs import lower
from dalembert.mechanics.derive import derive
from dalembert.reduction import FORMULATIONS, reduce
from dalembert.reduction.variational import variational
from dalembert.scene.reading import read
from hard_cases import CASES, hard_case


def assert_round_trip(program):
    text = str(program)
    back = Program.parse(text)
    assert back == program
    assert repr(back) == repr(program)  # which tells 0.0 from -0.0, and the order of mappings
    assert str(back) == text


def lowered(scene, formulation, outputs=()):
    """Return the program of a scene in a formulation, or in "projected" where that refuses it."""
    equations = derive(read(scene, tuple(outputs)))
    try:
        return lower(reduce(equations, formulation, [str(output) for output in outputs]))
    except FormulationError:
        return lowered(scene, "projected", outputs)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", da.scenes.ALL)
def test_programs_of_ready_scenes(name, formulation):
    assert_round_trip(lowered(da.scenes.ALL[name](), formulation))


@pytest.mark.parametrize("name", da.scenes.WITH_CONTACTS)
def test_programs_of_modes_of_contacts(name):
    model = da.compile_model(da.scenes.WITH_CONTACTS[name](), backend="numpy").mode()
    assert_round_trip(model.stages.program)


@pytest.mark.parametrize("name", CASES)
def test_programs_of_hard_cases(name):
    case = hard_case(name)
    formulation = list(FORMULATIONS)[list(CASES).index(name) % len(FORMULATIONS)]
    assert_round_trip(lowered(case.scene, formulation, case.outputs))


def test_a_program_of_sensitivities():
    reduced = reduce(derive(read(da.scenes.chaplygin_sleigh())), "projected")
    assert_round_trip(variational(reduced, ("x", "theta_dot"), ("b", "theta")))


def pulsed():
    """Return a scene with decided, nested and narrow conditions, and a default."""
    x = dynamicsymbols("x")
    m, A, on, w = sp.symbols("m A on w", positive=True)
    t = dynamicsymbols._t
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("pulsed", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", P, m))
    jump = A * sp.Heaviside(t**2 * sp.floor(t / on) - 2.5)
    scene.add_loads((P, (jump + sp.exp(-(((t - on) / w) ** 2))) * N.x))
    return scene


@cache
def pulsed_text():
    return str(lowered(pulsed(), "minimal"))


def test_a_program_with_conditions():
    program = lowered(pulsed(), "minimal")
    assert {NARROW, WHOLE, ZERO} == set(program.conditions.kinds)
    assert any(program.conditions.nested)
    assert any(kernel is not None for kernel in program.conditions.sharpness)
    assert program.layout.defaults
    assert_round_trip(program)


def test_the_program_of_a_model_is_printed():
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    assert str(model.stages.program).startswith(
        dedent("""\
        program chaplygin_sleigh
          formulation   minimal
          notes         "independent speeds: v_S_x, theta_dot",
                        "v_S_y is given by a nonholonomic constraint",
                        "chosen because its basis is regular at every configuration"
          coordinates   x, y, theta
          rates         x_dot, y_dot, theta_dot
          parameters    I_C, b, m
          unknowns      X, Y, N
          state         x, y, theta, v_S_x, theta_dot
          constraints   "nonholonomic constraint 1, -sin(theta)*Derivative(x, t) + cos(theta)*Derivative(y, t) = 0"
          holonomic     0
          constants     6
          assumptions   I_C: positive, b: positive, m: positive
        """)
    )
    assert dedent("""
        kernel rhs(t, y, c)
          theta = y[2]
          v_S_x = y[3]
          theta_dot = y[4]
          b = c[1]
          z_6 = c[3]
          cos_theta = cos(theta)
          z = cos_theta * v_S_x
          sin_theta = sin(theta)
          z_2 = v_S_x * sin_theta
          k = theta_dot * theta_dot
          z_4 = k * b
          k_2 = v_S_x * theta_dot
          z_8 = k_2 * z_6
          z_9 = -z_8
          out[0] = z  # rate of x
          out[1] = z_2  # rate of y
          out[2] = theta_dot  # rate of theta
          out[3] = z_4  # rate of v_S_x
          out[4] = z_9  # rate of theta_dot
        """) in str(model.stages.program)


SPECIAL = (
    "inf",
    "nan",
    "kernel",
    "out",
    "a b",
    "",
    "x.y",
    "\u03b8_\u0307",
    "\u03b8",
    "\n",
    "\u2028",
    "\ud83d\ude00",
    '"',
    "\\",
)
NAMES = st.one_of(st.sampled_from(SPECIAL), st.text(max_size=6), st.from_regex(r"[a-z_][a-z0-9_]{0,5}", fullmatch=True))
LITERALS = st.one_of(
    st.floats(allow_nan=False), st.sampled_from((0.0, -0.0, math.inf, -math.inf, math.nan, 5e-324, 0.1, -1e300, 1e22))
)
OPERANDS = st.one_of(NAMES, LITERALS)


@st.composite
def assignments(draw):
    op = draw(st.sampled_from(sorted(ALL_OPERATIONS.keys() - TABLE_OPERATIONS - CALL_OPERATIONS.keys())))
    return Assignment(draw(NAMES), op, tuple(draw(OPERANDS) for _ in range(ALL_OPERATIONS[op].arity)))


LOADS = st.builds(Load, NAMES, NAMES, st.one_of(st.none(), st.integers(-3, 99)))


def tuples(items, most=4):
    return st.lists(items, max_size=most).map(tuple)


KERNELS = st.builds(Kernel, NAMES, tuples(NAMES), tuples(LOADS), tuples(assignments(), 8), tuples(OPERANDS))


@settings(max_examples=60)
@given(KERNELS)
def test_any_kernel(kernel):
    back = Kernel.parse(str(kernel))
    assert repr(back) == repr(kernel)
    assert str(back) == str(kernel)


CONDITIONS = st.builds(
    lambda place, rows: Conditions(place, *(zip(*rows, strict=True) if rows else ((), (), (), ()))),
    st.one_of(st.none(), st.integers(0, 9)),
    st.lists(
        st.tuples(KERNELS, st.sampled_from((ZERO, WHOLE, NARROW)), st.booleans(), st.one_of(st.none(), KERNELS)),
        max_size=2,
    ),
)
LAYOUTS = st.builds(
    Layout,
    **dict.fromkeys(("coordinates", "rates", "parameters", "unknowns", "undetermined", "state"), tuples(NAMES)),
    **dict.fromkeys(("outputs", "constraints", "entries"), tuples(st.text())),
    **dict.fromkeys(("holonomic", "constants"), st.integers(0, 9)),
    aliases=st.dictionaries(NAMES, NAMES, max_size=4),
    defaults=st.dictionaries(NAMES, LITERALS, max_size=4),
    assumptions=st.dictionaries(NAMES, tuples(NAMES), max_size=4),
)


@settings(max_examples=60)
@given(
    st.builds(
        Program, NAMES, NAMES, LAYOUTS, tuples(KERNELS), tuples(NAMES), st.booleans(), NAMES, st.none() | CONDITIONS
    )
)
def test_any_program(program):
    back = Program.parse(str(program))
    assert repr(back) == repr(program)
    assert str(back) == str(program)


def test_every_operation_in_its_notation():
    a, b = "a", -2.0
    expected = {
        "add": "a + (-2.0)",
        "sub": "a - (-2.0)",
        "mul": "a * (-2.0)",
        "div": "a / (-2.0)",
        "pow": "a ** (-2.0)",
        "less": "a < (-2.0)",
        "less_equal": "a <= (-2.0)",
        "neg": "-a",
        "select": "select(a, -2.0, a)",
        "fma": "fma(a, -2.0, a)",
    }
    for name, operation in ALL_OPERATIONS.items():
        args = (a, b, a)[: operation.arity]
        text = expected.get(name, f"{name}({', '.join(map(str, args))})")
        assert str(Assignment("z", name, args)) == f"z = {text}"
    for args, text in (((b, a), "z = (-2.0) ** a"), ((-0.0, a), "z = (-0.0) ** a"), ((3.0, a), "z = 3.0 ** a")):
        assert str(Assignment("z", "pow", args)) == text
    assert str(Assignment("z", "mul", (b, a))) == "z = -2.0 * a"
    assert str(Assignment("z", "neg", (b,))) == "z = -(-2.0)"


def test_comments_blanks_and_lines_that_go_on_mean_nothing():
    text = dedent("""

        # what this is
        kernel rhs(t,
                   y, c)   # arguments
        a = y[0]

            z=a*-2.0
          w = select(a, z,
                     -(-1.5))
    out[0] = w  # rate of "a", or so
    """).replace("-(-1.5)", "(-1.5)")
    kernel = Kernel.parse(text)
    body = (Assignment("z", "mul", ("a", -2.0)), Assignment("w", "select", ("a", "z", -1.5)))
    assert kernel == Kernel("rhs", ("t", "y", "c"), (Load("a", "y", 0),), body, ("w",))


GOOD = """\
program sleigh
  formulation minimal
  coordinates x
  holonomic 0
  constants 1

kernel rhs(t, y, c)
  x = y[0]
  z = x * 2.0
  out[0] = z
"""

FAULTS = {
    "no program": ("program", "scene", 1, "'program'", "scene"),
    "no name": ("program sleigh", "program", 1, "the name of the program", "the end of the line"),
    "unknown field": ("  coordinates x", "  coordinate x", 3, "one of notes, nonanalytic", "coordinate"),
    "field given twice": ("  holonomic 0", "  coordinates y\n  holonomic 0", 4, "one of", "coordinates"),
    "field missing": ("  holonomic 0\n", "", 6, "'holonomic' of the program", "kernel"),
    "no number": ("holonomic 0", "holonomic none", 4, "a whole number", "none"),
    "fraction for a count": ("constants 1", "constants 1.5", 5, "a whole number", "1.5"),
    "list without comma": ("coordinates x", "coordinates x y", 3, "','", "y"),
    "no arguments": ("rhs(t, y, c)", "rhs", 7, "'('", "the end of the line"),
    "unknown function": ("x * 2.0", "cosine(x)", 9, "one of the functions add, sub", "cosine"),
    "too few operands": ("x * 2.0", "fma(x, x)", 9, "3 operands of fma, not 2", ")"),
    "two operations": ("x * 2.0", "x * 2.0 + x", 9, "the end of the line", "+"),
    "a value alone": ("x * 2.0", "2.0", 9, "an operation: +, -, *", "the end of the line"),
    "an operand missing": ("x * 2.0", "x *", 9, "a name or a number", "the end of the line"),
    "outputs out of order": ("out[0]", "out[1]", 10, "'0'", "1"),
    "an assignment behind outputs": ("out[0] = z", "out[0] = z\n  w = x + x", 11, "an output, or the end", "w"),
    "foreign character": ("x * 2.0", "x ; 2.0", 9, "a name, a number or an operation", "; 2.0"),
    "quote left open": ("coordinates x", 'coordinates "x', 3, "a closing double quote", '"x'),
    "unknown escape": ("coordinates x", 'coordinates "\\q"', 3, "an escape of", "q"),
    "word for a kernel": ("kernel rhs", "function rhs", 7, "or 'kernel'", "function"),
    "something behind": ("out[0] = z\n", "out[0] = z\nend\n", 11, "'kernel', 'conditions' or the end", "end"),
    "key given twice": ("  holonomic 0", "  defaults a: 1, a: 2\n  holonomic 0", 4, "no second value of 'a'", ":"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_cannot_be_read_is_refused_with_its_line(name):
    old, new, line, expected, found = FAULTS[name]
    Program.parse(GOOD)
    assert old in GOOD
    with pytest.raises(ProgramTextError) as caught:
        Program.parse(GOOD.replace(old, new, 1))
    assert caught.value.line == line
    assert expected in caught.value.expected
    assert found in caught.value.found
    assert str(caught.value).startswith(f"line {line}: expected ")


def test_a_kernel_alone_ends_with_its_text():
    kernel = Program.parse(GOOD).kernel("rhs")
    assert Kernel.parse(str(kernel)) == kernel
    with pytest.raises(ProgramTextError, match="line 5: expected an assignment, or the end, found kernel"):
        Kernel.parse(f"{kernel}\n{kernel}")


def test_text_tells_programs_apart():
    kernel = Program.parse(GOOD).kernel("rhs")
    other = replace(kernel, body=(Assignment("z", "mul", ("x", -2.0)),))
    zero, minus = (replace(kernel, outputs=(value,)) for value in (0.0, -0.0))
    assert len({str(k) for k in (kernel, other, zero, minus)}) == 4


PIECES = st.sampled_from(
    ('"', "\\", "(", ")", "[", "]", ",", ":", "=", "-", "**", "<", "#", "\n", "inf", "nan", "kernel")
)


@settings(max_examples=100)
@given(st.data())
def test_damaged_text_is_read_or_refused(data):
    text = data.draw(st.one_of(st.sampled_from((GOOD, pulsed_text())), KERNELS.map(str)))
    place = data.draw(st.integers(0, len(text)))
    damaged = text[:place] + data.draw(PIECES) + text[place + data.draw(st.integers(0, 5)) :]
    for parse in (Program.parse, Kernel.parse):
        try:
            read_back = parse(damaged)
        except ProgramTextError as error:
            assert 1 <= error.line <= damaged.count("\n") + 1
        else:
            assert repr(parse(str(read_back))) == repr(read_back)
