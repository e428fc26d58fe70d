"""Functional mock-up units: their description, and runs of their binary through the functions of the standard."""

import ctypes
import platform
import shutil
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest

import dalembert as da
from codegen.c_programs import built, compiler
from dalembert.errors import CapabilityError, MissingExtraError, OptionError
from dalembert.export import compilers
from export.pages import need_pages
from export.test_c_simulators import driven
from hard_cases import hard_case

START, NUMBERS = {"x": 0.1, "x_dot": 0, "z": 0.3}, {"k": 2.0, "m": 1.5}
TOLERANCES = {"rtol": 1e-10, "atol": 1e-12}
Reals, References = ctypes.c_double * 1, ctypes.c_uint * 1


@pytest.fixture(scope="module")
def model():
    return da.compile_model(driven(), outputs=["x_ddot"])


def unit(model, path, **options):
    """Export a unit; return its description and the folder that it is unpacked to."""
    model.export(path, "fmu", **options)
    folder = path.parent / path.stem
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return ElementTree.parse(folder / "modelDescription.xml").getroot(), folder


class Unit:
    """An instance of a unit, which is called as importers do."""

    def __init__(self, description, folder):
        if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
            pytest.skip("FMI 2.0 has no name for this platform")
        compiler()
        name = description.find("CoSimulation").get("modelIdentifier")
        self.library = ctypes.CDLL(str(folder / "binaries" / "linux64" / f"{name}.so"))
        self.numbers = {v.get("name"): int(v.get("valueReference")) for v in description.iter("ScalarVariable")}
        self.library.fmi2Instantiate.restype = ctypes.c_void_p
        self.guid = description.get("guid")
        self.instance = self.instantiated(self.guid)

    def instantiated(self, guid):
        return self.library.fmi2Instantiate(b"unit", 1, guid.encode(), b"", None, 0, 0)

    def call(self, name, *arguments):
        return getattr(self.library, f"fmi2{name}")(ctypes.c_void_p(self.instance), *arguments)

    def begin(self, t, **values):
        assert self.call("SetupExperiment", 0, ctypes.c_double(0), ctypes.c_double(t), 0, ctypes.c_double(0)) == 0
        assert self.call("EnterInitializationMode") == 0
        for name, value in values.items():
            self.set(name, value)
        return self.call("ExitInitializationMode")

    def set(self, name, value):
        return self.call("SetReal", References(self.numbers[name]), ctypes.c_size_t(1), Reals(value))

    def slope(self, name, value):
        given = References(self.numbers[name]), ctypes.c_size_t(1), (ctypes.c_int * 1)(1), Reals(value)
        assert self.call("SetRealInputDerivatives", *given) == 0

    def get(self, name):
        value = Reals()
        assert self.call("GetReal", References(self.numbers[name]), ctypes.c_size_t(1), value) == 0
        return value[0]

    def step(self, t, size):
        return self.call("DoStep", ctypes.c_double(t), ctypes.c_double(size), 1)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_a_driven_mass_moves_as_in_simulate(tmp_path, model, method):
    """With an input that is set with its slope, and from a state that was saved and restored."""
    mass = Unit(
        *unit(model, tmp_path / "mass.fmu", initial=START, parameters={**NUMBERS, "m": 9}, method=method, **TOLERANCES)
    )
    assert mass.begin(0.0, m=1.5, x_start=0.1) == 0
    saved = ctypes.c_void_p()
    for k in (*range(8), *range(4, 10)):
        if k == 4 and not saved:
            assert mass.call("GetFMUstate", ctypes.byref(saved)) == 0
        elif k == 4:
            size = ctypes.c_size_t()
            assert mass.call("SerializedFMUstateSize", saved, ctypes.byref(size)) == 0
            data, again = ctypes.create_string_buffer(size.value), ctypes.c_void_p()
            assert mass.call("SerializeFMUstate", saved, data, size) == 0
            assert mass.call("DeSerializeFMUstate", data, size, ctypes.byref(again)) == 0
            assert mass.call("SetFMUstate", again) == 0
        mass.set("force", 0.5 + 0.15 * k)
        mass.slope("force", 0.5)
        assert mass.step(0.3 * k, 0.3) == 0
    force = da.samples([0, 3], [0.5, 2.0], kind="linear")
    run = model.simulate((0, 3), START, NUMBERS, inputs={"force": force}, t_eval=[3.0], method=method, **TOLERANCES)
    for name in ("x", "x_dot", "z", "x_ddot"):
        assert mass.get(name) == pytest.approx(run[name][-1], rel=1e-10, abs=1e-10)
    mass.call("Reset")
    assert mass.begin(1.0) == 0 and mass.get("x") == 0.1
    mass.call("FreeInstance")


def test_what_a_unit_refuses(tmp_path):
    case = hard_case("pendulum, Cartesian (IFToMM A01)")
    pendulum = Unit(
        *unit(case.compile("projected"), tmp_path / "a.fmu", initial=case.initial, parameters=case.parameters)
    )
    assert pendulum.instantiated("another") is None
    x = next(name for name in pendulum.numbers if name.endswith("_start"))
    assert pendulum.begin(0.0, **{x: 7.0}) == 3  # fmi2Error: it contradicts the constraint
    output = next(name for name in pendulum.numbers if f"{name}_start" in pendulum.numbers)
    assert pendulum.set(output, 1.0) == 3
    pendulum.call("Reset")
    assert pendulum.begin(0.0) == 0 and pendulum.step(0.0, 0.1) == 0
    assert pendulum.set(x, 1.0) == 3  # the run has begun


def test_the_description_names_everything_once(tmp_path, model):
    description, folder = unit(model, tmp_path / "mass.fmu", initial=START, parameters=NUMBERS, t_span=(0, 3))
    variables = list(description.iter("ScalarVariable"))
    names = [variable.get("name") for variable in variables]
    assert names == ["x_start", "x_dot_start", "z_start", "k", "m", "force", "x", "x_dot", "z", "x_ddot"]
    references = [variable.get("valueReference") for variable in variables]
    assert len(set(references)) == len(references)
    outputs = [
        variables[int(item.get("index")) - 1].get("causality") for item in description.find("ModelStructure/Outputs")
    ]
    assert outputs == ["output"] * 4
    for file in description.iter("File"):
        assert (folder / "sources" / file.get("name")).is_file()
    assert description.find("DefaultExperiment").get("stopTime") == "3.0"


def test_sources_have_no_warnings(tmp_path, model):
    _, folder = unit(model, tmp_path / "mass.fmu", initial=START, parameters=NUMBERS)
    built(folder / "sources", ["driven_mass.c", "fmi2.c"], "-shared", "-fPIC")


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
    with pytest.raises(OptionError, match=r"fmi is '3.0'.*'2.0'"):
        model.export(tmp_path / "a.fmu", "fmu", initial=START, parameters=NUMBERS, fmi="3.0")
    (tmp_path / "a.fmu").write_text("mine")
    with pytest.raises(OptionError, match="was not written by an export"):
        model.export(tmp_path / "a.fmu", "fmu", initial=START, parameters=NUMBERS)
    assert (tmp_path / "a.fmu").read_text() == "mine"


def test_an_importer_takes_it(tmp_path, model):
    fmpy = pytest.importorskip("fmpy", reason="extra not installed")
    from fmpy.validation import validate_fmu

    path = model.export(
        tmp_path / "mass.fmu", "fmu", initial=START, parameters=NUMBERS, inputs={"force": 1}, **TOLERANCES
    )
    assert validate_fmu(str(path)) == []
    found = fmpy.simulate_fmu(str(path), stop_time=2, output_interval=0.1)
    run = model.simulate((0, 2), START, NUMBERS, inputs={"force": 1}, t_eval=found["time"], **TOLERANCES)
    np.testing.assert_allclose(found["x"], run["x"], rtol=1e-9, atol=1e-9)


def test_a_binary_for_another_machine(tmp_path, model):
    need_pages()
    _, folder = unit(model, tmp_path / "mass.fmu", initial=START, parameters=NUMBERS, platforms=["aarch64-linux"])
    assert [path.name for path in (folder / "binaries").iterdir()] == ["aarch64-linux"]
    library = (folder / "binaries" / "aarch64-linux" / "driven_mass.so").read_bytes()
    assert library.startswith(b"\x7fELF") and int.from_bytes(library[18:20], "little") == 183  # EM_AARCH64
    for function in ("Instantiate", "DoStep", "GetReal", "SetReal", "GetFMUstate", "FreeInstance"):
        assert f"fmi2{function}\0".encode() in library


def test_platforms_that_are_wrong(tmp_path, model, monkeypatch):
    given = {"initial": START, "parameters": NUMBERS}
    with pytest.raises(OptionError, match="platform 'beos'"):
        model.export(tmp_path / "a.fmu", "fmu", platforms=["beos"], **given)
    with pytest.raises(OptionError, match="platforms are those of the kind 'fmu'"):
        model.export(tmp_path / "a", "c", platforms=["win64"], **given)
    monkeypatch.setattr(compilers, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"for other machines.*pip install"):
        model.export(tmp_path / "a.fmu", "fmu", platforms=["win64"], **given)
