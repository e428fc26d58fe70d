"""Functional mock-up units: their description, and runs of their binary through the functions of the standard."""

import re
import shutil
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from codegen.c_programs import OPTIMISED, built
from dalembert.errors import CapabilityError, MissingExtraError, OptionError
from dalembert.export import compilers
from export.pages import need_pages
from export.test_c_simulators import driven
from export.units import VERSIONS, Unit, unpacked, variables_of
from hard_cases import hard_case

START, NUMBERS = {"x": 0.1, "x_dot": 0, "z": 0.3}, {"k": 2.0, "m": 1.5}
TOLERANCES = {"rtol": 1e-10, "atol": 1e-12}


@pytest.fixture(scope="module")
def model():
    return da.compile_model(driven(), outputs=["x_ddot"])


def run_with_jumps(mass):
    """Run a driven mass in steps, with an input that jumps between them, twice from step 4 on; return its values."""
    assert mass.begin(0.0, m=1.5, x_start=0.1) == 0
    restore = None
    for k in (*range(8), *range(4, 10)):
        if k == 4:
            restore = mass.again() if restore is None else restore() or restore
        mass.set("force", 0.5 + 0.15 * k)
        assert mass.step(0.3 * k, 0.3) == 0
    return {name: mass.get(name) for name in ("x", "x_dot", "z", "x_ddot")}


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_a_driven_mass_moves_as_in_simulate_in_both_versions(tmp_path, model, method):
    """With an input that jumps between steps, and from a state that was saved and restored."""
    found = []
    for version in VERSIONS:
        given = {"initial": START, "parameters": {**NUMBERS, "m": 9}, "method": method, "fmi": version, **TOLERANCES}
        mass = Unit(*unpacked(model, tmp_path / f"mass{version[0]}.fmu", **given))
        found.append(run_with_jumps(mass))
        mass.call("Reset")
        assert mass.begin(1.0) == 0 and mass.get("x") == 0.1
        mass.call("FreeInstance")
    assert found[0] == found[1]  # to the last bit
    steps = np.arange(11)
    force = da.samples(0.3 * steps, 0.5 + 0.15 * steps, kind="hold")
    run = model.simulate((0, 3), START, NUMBERS, inputs={"force": force}, t_eval=[3.0], method=method, **TOLERANCES)
    for name, value in found[0].items():
        assert value == pytest.approx(run[name][-1], rel=1e-10, abs=1e-10)


def test_inputs_have_slopes_in_version_2(tmp_path, model):
    mass = Unit(*unpacked(model, tmp_path / "mass.fmu", initial=START, parameters=NUMBERS, **TOLERANCES))
    assert mass.begin(0.0) == 0
    for k in range(10):
        mass.set("force", 0.5 + 0.15 * k)
        mass.slope("force", 0.5)
        assert mass.step(0.3 * k, 0.3) == 0
    force = da.samples([0, 3], [0.5, 2.0], kind="linear")
    run = model.simulate((0, 3), START, NUMBERS, inputs={"force": force}, t_eval=[3.0], **TOLERANCES)
    for name in ("x", "x_dot", "z", "x_ddot"):
        assert mass.get(name) == pytest.approx(run[name][-1], rel=1e-10, abs=1e-10)


@pytest.mark.parametrize("version", VERSIONS)
def test_outputs_follow_inputs_at_once(tmp_path, model, version):
    """Between steps too: where an output depends on an input directly, it has its present value."""
    mass = Unit(*unpacked(model, tmp_path / "mass.fmu", initial=START, parameters=NUMBERS, fmi=version))
    assert mass.begin(0.0) == 0 and mass.step(0.0, 0.5) == 0
    before = mass.get("x_ddot")
    mass.set("force", 3.0)
    assert mass.get("x_ddot") - before == pytest.approx(3.0 / NUMBERS["m"], rel=1e-14)
    assert version == "2.0" or mass.get("time") == 0.5


@pytest.mark.parametrize("version", VERSIONS)
def test_what_a_unit_refuses(tmp_path, version):
    case = hard_case("pendulum, Cartesian (IFToMM A01)")
    given = {"initial": case.initial, "parameters": case.parameters, "fmi": version}
    pendulum = Unit(*unpacked(case.compile("projected"), tmp_path / "a.fmu", **given))
    assert pendulum.instantiated("another") is None
    x = next(name for name in pendulum.numbers if name.endswith("_start"))
    assert pendulum.begin(0.0, **{x: 7.0}) == 3  # an error: it contradicts the constraint
    output = next(name for name in pendulum.numbers if f"{name}_start" in pendulum.numbers)
    assert pendulum.set(output, 1.0) == 3
    pendulum.call("Reset")
    assert pendulum.begin(0.0) == 0 and pendulum.step(0.0, 0.1) == 0
    assert pendulum.set(x, 1.0) == 3  # the run has begun


@pytest.mark.parametrize("version", VERSIONS)
def test_the_description_names_everything_once(tmp_path, model, version):
    given = {"initial": START, "parameters": NUMBERS, "t_span": (0, 3), "fmi": version}
    description, folder = unpacked(model, tmp_path / "mass.fmu", **given)
    variables = variables_of(description)
    names = [variable.get("name") for variable in variables]
    expected = ["x_start", "x_dot_start", "z_start", "k", "m", "force", "x", "x_dot", "z", "x_ddot"]
    expected += ["der(x)", "der(x_dot)", "der(z)"] + (["time"] if version == "3.0" else [])
    assert names == expected
    references = [variable.get("valueReference") for variable in variables]
    assert len(set(references)) == len(references)
    by_key = dict(zip(references, variables, strict=True))
    if version == "2.0":
        by_key = {str(place): variable for place, variable in enumerate(variables, 1)}
    states = [variable.find("Real") if version == "2.0" else variable for variable in variables[10:13]]
    assert [by_key[state.get("derivative")].get("name") for state in states] == ["x", "x_dot", "z"]
    key, outputs = ("index", "Outputs/Unknown") if version == "2.0" else ("valueReference", "Output")
    found = [by_key[item.get(key)] for item in description.findall(f"ModelStructure/{outputs}")]
    assert [variable.get("causality") for variable in found] == ["output"] * 4
    assert description.find("DefaultExperiment").get("stopTime") == "3.0"
    listed = [item.get("name") for item in description.findall("ModelExchange//File")]
    if version == "3.0":
        build = ElementTree.parse(folder / "sources" / "buildDescription.xml")
        listed = [item.get("name") for item in build.iter("SourceFile")]
    assert listed == ["driven_mass.c", f"fmi{version[0]}.c"]
    assert all((folder / "sources" / name).is_file() for name in listed)


def test_no_name_is_taken_twice(tmp_path):
    """Names of the unit's own give way to those of the scene."""
    scene = driven()
    scene.add_states({dynamicsymbols("x_start"): 1, dynamicsymbols("time"): 2})
    model = da.compile_model(scene)
    start = {**START, "x_start": 0, "time": 0}
    description, _ = unpacked(model, tmp_path / "a.fmu", initial=start, parameters=NUMBERS, fmi="3.0")
    names = [variable.get("name") for variable in variables_of(description)]
    assert len(set(names)) == len(names) and {"x_start", "x_start_", "time", "time_"} <= {*names}


@pytest.mark.parametrize("name", ["state", "unit"])
def test_scenes_may_have_names_of_the_code(tmp_path, name):
    x, N, O = dynamicsymbols("x"), ReferenceFrame("N"), Point("O")
    scene = da.Scene(name, frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("cart", O.locatenew("P", x * N.x), symbols("m")))
    given = {"initial": {"x": 0, "x_dot": 2}, "parameters": {"m": 1}}
    unit = Unit(*unpacked(da.compile_model(scene), tmp_path / "a.fmu", **given))
    assert unit.begin(0.0) == 0 and unit.step(0.0, 1.5) == 0 and unit.get("x") == 3.0


@pytest.mark.parametrize("version", VERSIONS)
def test_sources_have_no_warnings(tmp_path, model, version):
    _, folder = unpacked(model, tmp_path / "mass.fmu", initial=START, parameters=NUMBERS, fmi=version)
    built(folder / "sources", ["driven_mass.c", f"fmi{version[0]}.c"], "-shared", "-fPIC", *OPTIMISED)
    case = hard_case("pendulum, Cartesian (IFToMM A01)")
    given = {"initial": case.initial, "parameters": case.parameters, "fmi": version}
    _, folder = unpacked(case.compile("projected"), tmp_path / "pendulum.fmu", **given)
    sources = [path.name for path in (folder / "sources").glob("*.c")]
    built(folder / "sources", sources, "-shared", "-fPIC", *OPTIMISED)


@pytest.mark.parametrize("version", VERSIONS)
def test_functions_are_declared_as_in_the_standard(tmp_path, model, version):
    """Its headers, which fmpy has, declare the same: in place of the types of the unit they compile."""
    fmpy = pytest.importorskip("fmpy", reason="extra not installed")
    headers, digit = Path(fmpy.__file__).parent / "c-code", version[0]
    _, folder = unpacked(model, tmp_path / "mass.fmu", initial=START, parameters=NUMBERS, fmi=version)
    source = folder / "sources" / f"fmi{digit}.c"
    text = source.read_text()
    begin = text.index("/* Types of the standard. */")
    end = text.index("static int told", begin)
    assert text[begin:end].count("typedef") > 10
    prefix = f"#define FMI{digit}_OVERRIDE_FUNCTION_PREFIX\n"
    source.write_text(text[:begin] + f'{prefix}#include "fmi{digit}Functions.h"\n' + text[end:])
    declared = re.findall(rf"TYPE\s+(fmi{digit}\w+);", (headers / f"fmi{digit}Functions.h").read_text())
    assert len(declared) > 30 and all(re.search(rf"\b{name}\(", text) for name in declared)
    built(folder / "sources", ["driven_mass.c", source.name], "-shared", "-fPIC", f"-I{headers}")


def test_the_same_model_gives_the_same_archive_without_a_compiler(tmp_path, model, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(compilers, "find_spec", lambda name: None)
    first, second = tmp_path / "a.fmu", tmp_path / "b.fmu"
    for path in (first, second, first):
        model.export(path, "fmu", initial=START, parameters=NUMBERS)
    assert first.read_bytes() == second.read_bytes()
    assert not [name for name in zipfile.ZipFile(first).namelist() if name.startswith("binaries")]


def test_units_need_all_start_values_and_their_own_file(tmp_path, model):
    with pytest.raises(CapabilityError, match=r"start value for each.*Missing: k, m"):
        model.export(tmp_path / "a.fmu", "fmu", initial=START)
    with pytest.raises(OptionError, match=r"ends in '.fmu'"):
        model.export(tmp_path / "a", "fmu", initial=START, parameters=NUMBERS)
    for wrong in ("1.0", "3", 3.0, None):
        with pytest.raises(OptionError, match=r"fmi is .*'2.0', '3.0'"):
            model.export(tmp_path / "a.fmu", "fmu", initial=START, parameters=NUMBERS, fmi=wrong)
    with pytest.raises(OptionError, match="fmi is the version of the kind 'fmu'"):
        model.export(tmp_path / "a", initial=START, parameters=NUMBERS, fmi="3.0")
    (tmp_path / "a.fmu").write_text("mine")
    with pytest.raises(OptionError, match="was not written by an export"):
        model.export(tmp_path / "a.fmu", "fmu", initial=START, parameters=NUMBERS)
    assert (tmp_path / "a.fmu").read_text() == "mine"


@pytest.mark.parametrize("version", VERSIONS)
def test_an_importer_takes_it(tmp_path, model, version):
    fmpy = pytest.importorskip("fmpy", reason="extra not installed")
    from fmpy.validation import validate_fmu

    given = {"initial": START, "parameters": NUMBERS, "inputs": {"force": 1}, "fmi": version, **TOLERANCES}
    path = model.export(tmp_path / "mass.fmu", "fmu", **given)
    assert validate_fmu(str(path)) == []
    found = fmpy.simulate_fmu(str(path), stop_time=2, output_interval=0.1)
    run = model.simulate((0, 2), START, NUMBERS, inputs={"force": 1}, t_eval=found["time"], **TOLERANCES)
    np.testing.assert_allclose(found["x"], run["x"], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("version", "functions"), [
    ("2.0", ("Instantiate", "DoStep", "GetReal", "SetReal", "GetDerivatives", "GetFMUstate", "FreeInstance")),
    ("3.0", ("InstantiateModelExchange", "DoStep", "GetFloat64", "UpdateDiscreteStates", "GetFMUState")),
])  # fmt: skip
def test_a_binary_for_another_machine(tmp_path, model, monkeypatch, version, functions):
    """With the options that users have: without optimisation ziglang compiles twice as much of its own libraries."""
    need_pages()
    monkeypatch.setattr(compilers, "_LIBRARY", tuple("-O2" if each == "-O0" else each for each in compilers._LIBRARY))
    given = {"initial": START, "parameters": NUMBERS, "platforms": ["aarch64-linux"], "fmi": version}
    _, folder = unpacked(model, tmp_path / "mass.fmu", **given)
    assert [path.name for path in (folder / "binaries").iterdir()] == ["aarch64-linux"]
    library = (folder / "binaries" / "aarch64-linux" / "driven_mass.so").read_bytes()
    assert library.startswith(b"\x7fELF") and int.from_bytes(library[18:20], "little") == 183  # EM_AARCH64
    for function in functions:
        assert f"fmi{version[0]}{function}\0".encode() in library


@pytest.mark.matrix
@pytest.mark.parametrize(("platform", "begins"), [("win64", b"MZ"), ("darwin64", b"\xcf\xfa\xed\xfe")])
def test_binaries_for_systems_that_are_not_here(tmp_path, model, platform, begins):
    """Their libraries take a minute to compile at first."""
    need_pages()
    given = {"initial": START, "parameters": NUMBERS, "platforms": [platform], "fmi": "2.0"}
    _, folder = unpacked(model, tmp_path / "mass.fmu", **given)
    (library,) = (folder / "binaries" / platform).iterdir()
    assert library.read_bytes().startswith(begins) and b"fmi2DoStep\0" in library.read_bytes()


def test_platforms_that_are_wrong(tmp_path, model, monkeypatch):
    given = {"initial": START, "parameters": NUMBERS}
    with pytest.raises(OptionError, match="platform 'beos'"):
        model.export(tmp_path / "a.fmu", "fmu", platforms=["beos"], **given)
    with pytest.raises(OptionError, match="platforms are those of the kind 'fmu'"):
        model.export(tmp_path / "a", "c", platforms=["win64"], **given)
    monkeypatch.setattr(compilers, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"for other machines.*pip install"):
        model.export(tmp_path / "a.fmu", "fmu", platforms=["win64"], **given)
