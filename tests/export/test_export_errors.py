"""What is not exported, and paths at which something else is."""

from pathlib import Path

import pytest
from sympy import Piecewise, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import CapabilityError, InitialStateError, OptionError
from dalembert.export.kinds import table_of_kinds
from system.singular_scenes import bars

SLEIGH = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}


@pytest.fixture(scope="module")
def sleigh():
    return da.compile_model(da.scenes.chaplygin_sleigh())


def cart(**options):
    """Return a cart on a line, and its coordinate."""
    x, N, O = dynamicsymbols("x"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    P = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("cart", P, symbols("m")))
    return scene, x, P, N


def test_an_earlier_export_is_replaced(tmp_path, sleigh):
    path = tmp_path / "here"
    assert sleigh.export(path) == path
    first = (path / "chaplygin_sleigh.c").read_text()
    sleigh.export(str(path), rtol=1e-4)
    assert (path / "chaplygin_sleigh.c").read_text() != first
    assert {item.name for item in tmp_path.iterdir()} == {"here"}


def test_an_empty_folder_is_filled(tmp_path, sleigh):
    (tmp_path / "here").mkdir()
    assert (sleigh.export(tmp_path / "here") / "main.c").exists()


def test_nothing_of_others_is_overwritten(tmp_path, sleigh):
    folder, file = tmp_path / "folder", tmp_path / "file"
    folder.mkdir()
    (folder / "thesis.tex").write_text("ten years")
    file.write_text("more")
    with pytest.raises(OptionError, match=r"was not written by an export.*thesis\.tex"):
        sleigh.export(folder)
    with pytest.raises(OptionError, match="is no folder of an export"):
        sleigh.export(file)
    assert (folder / "thesis.tex").read_text() == "ten years" and file.read_text() == "more"


def test_an_export_that_was_changed_is_kept(tmp_path, sleigh):
    path = sleigh.export(tmp_path / "here")
    (path / "mine.c").write_text("int mine;")
    with pytest.raises(OptionError, match=r"holds what would be lost: mine\.c"):
        sleigh.export(path)
    (path / "mine.c").unlink()
    main = path / "main.c"
    main.write_text(main.read_text() + "/* mine */\n")
    with pytest.raises(OptionError, match=r"main.c \(changed since\)"):
        sleigh.export(path)
    assert main.read_text().endswith("/* mine */\n")


@pytest.mark.parametrize(
    ("path", "message"), [("", "give the folder"), (3, "give the folder"), ("/", "give a new folder")]
)
def test_paths_that_are_none(sleigh, path, message):
    with pytest.raises(OptionError, match=message):
        sleigh.export(path)


def test_the_folder_around_it_exists(tmp_path, sleigh):
    with pytest.raises(OptionError, match="does not exist: make it first"):
        sleigh.export(tmp_path / "no" / "where")


def test_unknown_options(tmp_path, sleigh):
    with pytest.raises(OptionError, match=r"kind of export .matlab.*c"):
        sleigh.export(tmp_path / "a", "matlab")
    with pytest.raises(OptionError, match="method 'euler'"):
        sleigh.export(tmp_path / "a", method="euler")
    with pytest.raises(OptionError, match="must not both be 0"):
        sleigh.export(tmp_path / "a", rtol=0, atol=0)
    with pytest.raises(OptionError, match="input 'u'"):
        sleigh.export(tmp_path / "a", inputs={"u": 1.0})
    with pytest.raises(InitialStateError, match="initial values are missing"):
        sleigh.export(tmp_path / "a", initial={"x": 0})
    assert list(tmp_path.iterdir()) == []


def test_formulations_that_need_more_than_a_loop(tmp_path):
    scene = da.scenes.chaplygin_sleigh()
    with pytest.raises(CapabilityError, match="'baumgarte': compile it with formulation='projected'"):
        da.compile_model(scene, formulation="baumgarte").export(tmp_path / "a")


def test_functions_of_time_with_kinks_are_refused_where_steps_do_not_end_at_them(tmp_path):
    scene, _x, P, N = cart()
    scene.add_loads((P, Piecewise((1, dynamicsymbols._t < 1), (0, True)) * N.x))
    model = da.compile_model(scene)
    with pytest.raises(CapabilityError, match=r"'jax' does not carry functions of time with kinks.*add_inputs"):
        model.export(tmp_path / "a.py", "jax")
    with pytest.raises(
        CapabilityError, match=r"'rk4' does not carry functions of time with kinks.*its steps do not end"
    ):
        model.export(tmp_path / "a", method="rk4", step=0.1)


def test_the_page_has_the_table_of_kinds():
    page = Path(__file__).parents[2] / "docs" / "export.md"
    assert table_of_kinds() in page.read_text()


def test_inputs_that_move_bodies_are_refused(tmp_path):
    road, y, N, O = dynamicsymbols("road"), dynamicsymbols("y"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("car", frame=N, origin=O, coordinates=[y])
    scene.add_bodies(Particle("body", O.locatenew("B", (y + road) * N.y), symbols("m")))
    scene.add_inputs(road)
    with pytest.raises(CapabilityError, match="not those that move bodies or constraints: road"):
        da.compile_model(scene).export(tmp_path / "a")


def test_a_motion_that_is_prescribed_is_refused(tmp_path):
    scene, x, _P, _N = cart()
    scene.add_holonomic_constraints(x - dynamicsymbols._t)
    with pytest.raises(CapabilityError, match="there is nothing to simulate"):
        da.compile_model(scene).export(tmp_path / "a")


def test_constraints_that_depend_on_each_other_at_the_start_are_refused_where_the_example_shows_it(tmp_path):
    """Three parallel cranks, of which two would do; `simulate` leaves one of them out."""
    model = da.compile_model(bars())
    start = {"a": 0.3, "b": -0.3, "a_dot": -0.6, "b_dot": 0.6}
    assert model.simulate((0, 0.1), start, {"F": 0.1}).success
    with pytest.raises(CapabilityError, match="depend on each other at this start; simulate leaves out those that"):
        model.export(tmp_path / "bars", initial=start, parameters={"F": 0.1})
