"""A short, fixed part of the hostile inputs of `fuzz.hostile`, and the ones that were found first."""

import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.cache import directory
from dalembert.errors import ExpressionError, MissingExtraError, OptionError, SceneError
from dalembert.naming import Namer
from fuzz.hostile import Outcome, Targets, attack, deep


def test_hostile_inputs():
    targets, outcome = Targets(), Outcome()
    for seed in range(20_000, 20_150):
        attack(targets, seed, outcome)
    assert not outcome.defects, outcome.defects
    assert outcome.count == 150 and outcome.accepted > 5 and sum(outcome.refused.values()) > 100


def bead(load=0, *, coordinate="x", body="bead", name="bead"):
    x = dynamicsymbols(coordinate)
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene(name, frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle(body, P, 1))
    scene.add_loads((P, load * N.x))
    return scene


x, k = dynamicsymbols("x"), sp.Symbol("k")


@pytest.mark.parametrize(
    ("scene", "text"),
    [
        (lambda: bead(deep(600)), "nested more deeply"),
        (lambda: bead(10**400 * x), "beyond the range of double precision"),
        (lambda: bead(sp.Float("1e400") * x), "beyond the range of double precision"),
        (lambda: bead(x ** (10**400)), "has an exponent beyond"),
        (lambda: bead(sp.Symbol("a\ud800b") * x), "lone surrogate"),
        (lambda: bead(body="a\ud800b"), "lone surrogate"),
        (lambda: bead(name="a\ud800b"), "lone surrogate"),
    ],
)
def test_what_cannot_be_compiled_is_named(scene, text):
    with pytest.raises((SceneError, ExpressionError), match=text):
        da.compile_model(scene(), backend="numpy")


def test_long_names_stay_apart():
    name = Namer()
    first, second = name("a" * 1200 + "b"), name("a" * 1200 + "c")
    assert first != second and max(len(first), len(second)) < 600
    scene = bead(-sp.Symbol("a" * 1200 + "b") * x - sp.Symbol("a" * 1200 + "c"), coordinate="x")
    model = da.compile_model(scene)
    parameters = {"a" * 1200 + "b": 1.0, "a" * 1200 + "c": 2.0}
    assert model.simulate((0, 0.1), {"x": 1.0, "x_dot": 0.0}, parameters)["x"][-1] < 1


def test_a_text_is_no_expression(tmp_path):
    """SymPy would run it."""
    file = tmp_path / "written"
    scene = bead()
    scene.add_holonomic_constraints(f"__import__('pathlib').Path({str(file)!r}).touch()")
    with pytest.raises(SceneError, match="is not a SymPy expression"):
        da.compile_model(scene, backend="numpy")
    assert not file.exists()


def test_a_cache_folder_of_nobody(monkeypatch):
    monkeypatch.setenv("DALEMBERT_CACHE_DIR", "~nosuchuser/cache")
    with pytest.raises(OptionError, match="there is no such user"):
        directory()


def test_animations_without_a_writer(tmp_path, monkeypatch):
    from matplotlib.animation import writers

    model = da.compile_model(bead(-k * x), backend="numpy")
    animation = model.simulate((0, 0.2), {"x": 1, "x_dot": 0}, {"k": 1}).animate(fps=5)
    animation.save(tmp_path / "motion.html")
    assert (tmp_path / "motion.html").stat().st_size > 1000
    with pytest.raises(OptionError, match=r"end with \.gif, \.html"):
        animation.save(tmp_path / "motion.txt")
    monkeypatch.setattr(writers, "is_available", lambda name: name != "ffmpeg")
    with pytest.raises(MissingExtraError, match="install ffmpeg"):
        animation.save(tmp_path / "motion.mp4")
