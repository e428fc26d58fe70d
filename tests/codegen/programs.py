"""Programs written by hand, free of SymPy and of the graph: what golden files start from."""

from dalembert.ir.kernel import Assignment, Kernel, Load
from dalembert.ir.ops import OPERATIONS
from dalembert.ir.program import Layout, Program


def _layout(state, parameters, constants, **kwargs):
    empty = {name: () for name in ("coordinates", "rates", "unknowns", "undetermined", "outputs", "constraints")}
    return Layout(
        **{**empty, **kwargs},
        parameters=parameters,
        state=state,
        holonomic=0,
        constants=constants,
        aliases={},
    )


def oscillator():
    """A driven oscillator, x'' = -w**2 x + f sin(t)."""
    time, x, v = Load("t_2", "t", None), Load("x", "y", 0), Load("x_dot", "y", 1)
    prepare = Kernel(
        "prepare",
        ("p",),
        (Load("f", "p", 0), Load("w", "p", 1)),
        (Assignment("square", "mul", ("w", "w")),),
        ("f", "w", "square"),
    )
    rhs = Kernel(
        "rhs",
        ("t", "y", "c"),
        (Load("f", "c", 0), Load("square", "c", 2), time, x, v),
        (
            Assignment("sin_t", "sin", ("t_2",)),
            Assignment("drive", "mul", ("f", "sin_t")),
            Assignment("spring", "mul", ("square", "x")),
            Assignment("pull", "sub", ("drive", "spring")),
        ),
        ("x_dot", "pull"),
    )
    expand = Kernel("expand", ("t", "y", "c"), (x, v), (), ("x", "x_dot"))
    energy = Kernel(
        "energy",
        ("t", "y", "c"),
        (Load("square", "c", 2), x, v),
        (
            Assignment("a", "mul", ("x_dot", "x_dot")),
            Assignment("kinetic", "mul", (0.5, "a")),
            Assignment("b", "mul", ("x", "x")),
            Assignment("k", "mul", ("square", "b")),
            Assignment("potential", "div", ("k", 2.0)),
        ),
        ("kinetic", "potential"),
    )
    mass = Kernel("mass_matrix", ("t", "y", "c"), (), (), (1.0,))
    layout = _layout(("x", "x_dot"), ("f", "w"), 3, coordinates=("x",), rates=("x_dot",))
    return Program("oscillator", "minimal", layout, (prepare, rhs, expand, energy, mass), ())


def every_operation():
    """One kernel in which every operation occurs, with literals of every shape."""
    loads = (Load("t_2", "t", None), Load("a", "y", 0), Load("b", "y", 1))
    body = [Assignment(name, name, ("a", "b", "t_2")[: op.arity]) for name, op in OPERATIONS.items()]
    body = [Assignment(f"z_{line.target}", line.op, line.args) for line in body]
    body += [
        Assignment("small", "mul", (1e-300, "a")),
        Assignment("third", "add", ("b", 1 / 3)),
        Assignment("negative", "sub", ("a", -2.5)),
    ]
    outputs = (*(line.target for line in body), -0.125, 3.0, "t_2")
    rhs = Kernel("outputs", ("t", "y", "c"), loads, tuple(body), outputs)
    layout = _layout(("a", "b"), (), 0, outputs=tuple(f"out{i}" for i in range(len(outputs))))
    prepare = Kernel("prepare", ("p",), (), (), ())
    return Program("quotes \" ' and\nlines", "augmented", layout, (prepare, rhs), ())


def pendulum():
    """The right-hand side of a pendulum with drag, x'' = -w**2 sin(x) - d x'**2."""
    loads = (Load("square", "c", 0), Load("drag", "c", 1), Load("x", "y", 0), Load("x_dot", "y", 1))
    body = (
        Assignment("sine", "sin", ("x",)),
        Assignment("weight", "mul", ("square", "sine")),
        Assignment("speed", "mul", ("x_dot", "x_dot")),
        Assignment("resistance", "mul", ("drag", "speed")),
        Assignment("pull", "add", ("weight", "resistance")),
        Assignment("rate", "neg", ("pull",)),
    )
    return Kernel("rhs", ("t", "y", "c"), loads, body, ("x_dot", "rate"))


PROGRAMS = {"oscillator": oscillator, "every_operation": every_operation}
