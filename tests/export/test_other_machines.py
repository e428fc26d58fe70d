"""Exports on machines that are emulated: arm64 by QEMU, Windows by Wine, with the compiler of the package ziglang."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import dalembert as da
from codegen.c_programs import built, fuses, output
from corpus.named_scenes import READY
from export.test_c_simulators import rows
from export.units import unpacked, variables_of
from hard_cases import hard_case

ARM = Path("/usr/aarch64-linux-gnu")
"""Where Debian's package libc6-arm64-cross has the C library of arm64."""

MACHINES = {
    "arm64": ("aarch64-linux-gnu.2.17", ["qemu-aarch64", "-L", str(ARM)]),
    "windows": ("x86_64-windows-gnu", ["wine"]),
}
"""Machines, with the target of the compiler, and with what runs their programs."""

UNITS = {"arm64": ("3.0", "aarch64-linux", "aarch64-linux/{}.so"), "windows": ("2.0", "win64", "win64/{}.dll")}
"""Of each machine the version of FMI, the platform and the binary of a unit."""

SCENES = {
    "ready: chaplygin_sleigh": "auto",
    "ready: corner_plate": "radau",
    "pendulum, Cartesian (IFToMM A01)": "auto",
    "chain of 8 pendulums": "dop853",
}
"""Scenes with their methods: steps of Taylor series, implicit steps, projections, Runge-Kutta steps."""

HOST = """
#include <stdio.h>
#include <stdlib.h>
#ifdef _WIN32
#include <windows.h>
#define LIBRARY(path) LoadLibraryA(path)
#define FUNCTION(name) ((void *)(uintptr_t)GetProcAddress(library, name))
#else
#include <dlfcn.h>
#define LIBRARY(path) dlopen(path, RTLD_NOW)
#define FUNCTION(name) dlsym(library, name)
#endif
int main(int argc, char **argv)
{
    unsigned reference = argc < 4 ? 0 : (unsigned)atoi(argv[3]);
    void *unit, *library = argc < 4 ? NULL : LIBRARY(argv[1]);
    double value;
    int k;
    if (library == NULL) {
        return 1;
    }
    %s
    return 0;
}
"""
"""An importer: takes the path of a binary, a token and a reference, and prints the variable at ten times."""

IMPORTERS = {
    "2.0": """
    void *(*make)(const char *, int, const char *, const char *, void *, int, int) = FUNCTION("fmi2Instantiate");
    int (*set_up)(void *, int, double, double, int, double) = FUNCTION("fmi2SetupExperiment");
    int (*enter)(void *) = FUNCTION("fmi2EnterInitializationMode");
    int (*leave)(void *) = FUNCTION("fmi2ExitInitializationMode");
    int (*step)(void *, double, double, int) = FUNCTION("fmi2DoStep");
    int (*get)(void *, const unsigned *, size_t, double *) = FUNCTION("fmi2GetReal");
    unit = make("unit", 1, argv[2], "", NULL, 0, 0);
    if (set_up(unit, 0, 0.0, 0.0, 0, 0.0) || enter(unit) || leave(unit)) {
        return 2;
    }
    for (k = 0; k < 10; k++) {
        if (step(unit, k / 10.0, 0.1, 1) || get(unit, &reference, 1, &value)) {
            return 3;
        }
        printf("%a\\n", value);
    }
""",
    "3.0": """
    void *(*make)(const char *, const char *, const char *, _Bool, _Bool, _Bool, _Bool, const unsigned *, size_t,
        void *, void *, void *) = FUNCTION("fmi3InstantiateCoSimulation");
    int (*enter)(void *, _Bool, double, double, _Bool, double) = FUNCTION("fmi3EnterInitializationMode");
    int (*leave)(void *) = FUNCTION("fmi3ExitInitializationMode");
    int (*step)(void *, double, double, _Bool, _Bool *, _Bool *, _Bool *, double *) = FUNCTION("fmi3DoStep");
    int (*get)(void *, const unsigned *, size_t, double *, size_t) = FUNCTION("fmi3GetFloat64");
    _Bool event, ended, early;
    double last;
    unit = make("unit", argv[2], "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
    if (enter(unit, 0, 0.0, 0.0, 0, 0.0) || leave(unit)) {
        return 2;
    }
    for (k = 0; k < 10; k++) {
        if (step(unit, k / 10.0, 0.1, 1, &event, &ended, &early, &last) || get(unit, &reference, 1, &value, 1)) {
            return 3;
        }
        printf("%a\\n", value);
    }
""",
}


def need(machine):
    """Skip a test where programs of a machine are not compiled and run."""
    _, runner = MACHINES[machine]
    if find_spec("ziglang") is None:
        pytest.skip("the package ziglang is not installed")
    if shutil.which(runner[0]) is None or (machine == "arm64" and not ARM.is_dir()):
        pytest.skip(f"{runner[0]} and a C library for {machine} are not installed")


def compiled_for(machine, folder, *sources):
    """Compile sources in a folder for a machine; return the command that runs the program."""
    target, runner = MACHINES[machine]
    command = [sys.executable, "-m", "ziglang", "cc", "-target", target, "-std=c99", "-O2", "-o", "program.exe"]
    done = subprocess.run([*command, *sources, "-lm"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:3000]
    return [*runner, str(folder / "program.exe")]


def printed(command):
    """Return what a program of another machine prints."""
    quiet = {**os.environ, "WINEDEBUG": "-all"}
    done = subprocess.run(command, capture_output=True, text=True, env=quiet)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("name", SCENES)
def test_programs_move_as_in_simulate(tmp_path, name, machine):
    need(machine)
    case = READY[name] if name in READY else hard_case(name)
    model, method = da.compile_model(case.build() if name in READY else case.scene), SCENES[name]
    given = {"method": method, "rtol": 1e-10, "atol": 1e-12}
    folder = model.export(tmp_path / "a", initial=case.initial, parameters=case.parameters, t_span=(0, 1), **given)
    (source,) = (path.name for path in folder.glob("*.c") if path.name != "main.c")
    text = printed(compiled_for(machine, folder, "main.c", source))
    found = rows(text)
    run = model.simulate((0, 1), case.initial, case.parameters, t_eval=found["t"], **given)
    for key, values in found.items():
        np.testing.assert_allclose(values, run.t if key == "t" else run[key], rtol=1e-10, atol=1e-11, err_msg=key)
    if machine == "arm64" and fuses() and method == "auto":  # sizes of other steps need the C library
        assert text == output(built(folder, ["main.c", source]))


@pytest.mark.parametrize("machine", MACHINES)
def test_units_move_as_in_simulate(tmp_path, machine):
    need(machine)
    case = READY["ready: chaplygin_sleigh"]
    model = da.compile_model(case.build())
    version, platform, binary = UNITS[machine]
    values = {"initial": case.initial, "parameters": case.parameters}
    given = {"rtol": 1e-10, "atol": 1e-12}
    description, folder = unpacked(model, tmp_path / "unit.fmu", fmi=version, platforms=[platform], **values, **given)
    (reference,) = (v.get("valueReference") for v in variables_of(description) if v.get("name") == "theta")
    token = description.get("guid") or description.get("instantiationToken")
    (tmp_path / "host.c").write_text(HOST % IMPORTERS[version].strip())
    library = folder / "binaries" / binary.format("chaplygin_sleigh")
    text = printed([*compiled_for(machine, tmp_path, "host.c"), str(library), token, reference])
    run = model.simulate((0, 1), case.initial, case.parameters, t_eval=np.arange(1, 11) / 10, **given)
    np.testing.assert_allclose([float.fromhex(line) for line in text.split()], run["theta"], rtol=1e-12)
