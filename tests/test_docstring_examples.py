"""Examples in the docstrings of the public functions and classes: they run as written, one after the other."""

import inspect
import re
import textwrap

import numpy as np
import pytest
import sympy
from sympy.physics import mechanics

import dalembert as da
from dalembert.model.model import CompiledModel

OBJECTS = {name: getattr(da, name) for name in da.__all__ if name not in ("__version__", "errors", "scenes")}
METHODS = {name: getattr(CompiledModel, name) for name in ("simulate", "sweep", "prepare", "sensitivity", "linearize")}
WITHOUT = {"LagrangeView", "Screw", "feedback"}
"""Made by other functions; and what is for programs in JAX, which the page on them shows."""
SHAPES = {"Box", "Cylinder", "Disk", "Ground", "Mesh", "Path", "Rod", "Sphere", "Spring"}
"""`Scene.add_shapes` has their example."""
ELSEWHERE = {"final", "first_crossing", "mean", "minimum", "normal", "sobol_cases", "uniform"}
"""Named in the examples of `maximum` and `random_cases`, or their siblings."""
PENDULUM = ("Scene", "compile_model")
"""The examples that all others follow."""


def example(name):
    text = inspect.getdoc({**OBJECTS, **METHODS}[name])
    blocks = re.findall(r"::\n\n((?:    .*\n|\n)+)", text.partition("Examples\n")[2] + "\n")
    return "\n".join(textwrap.dedent(block) for block in blocks)


@pytest.fixture(scope="module")
def pendulum():
    """The names that the examples of a scene and of its model define."""
    names = {**vars(sympy), **vars(mechanics), "da": da, "np": np, "print": lambda *text: None}
    for name in PENDULUM:
        exec(example(name), names)
    return names


WRITTEN = sorted({*OBJECTS, *METHODS} - WITHOUT - SHAPES - ELSEWHERE - {*PENDULUM})


@pytest.mark.parametrize("name", WRITTEN)
def test_examples_run_as_written(pendulum, name):
    code = example(name)
    assert code.strip(), f"{name} has no example"
    mu, z, frame = sympy.Symbol("mu"), mechanics.dynamicsymbols("z"), mechanics.ReferenceFrame("B")
    free = dict(zip(("R_x", "R_y"), da.unknowns("R_x R_y"), strict=True))
    free |= {name: mechanics.Point(name) for name in "ACGH"} | {"L": mechanics.ReferenceFrame("L")}
    free |= {name: sympy.Symbol(name, positive=True) for name in ("a", "b", "r", "R", "T_0")}
    scene = pendulum["scene"].copy()
    exec(code, {**pendulum, "scene": scene, "mu": mu, "z": z, "B": frame, "model": pendulum["model"], **free})
