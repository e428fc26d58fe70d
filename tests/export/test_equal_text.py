"""Exports of the same scenes from two processes: every file has the same bytes."""

import os
import subprocess
import sys
from pathlib import Path

from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from export.test_contact_simulators import block
from export.test_events import pendulum
from hard_cases.contacts import contact_motion

MEMORY = "213"
"""A byte that glibc writes to memory that it hands out to the other process: files must not hold what lies there."""


def write_contacts_with_inputs_and_events(folder):
    """Export a block that an input pushes, with an event that maps its state."""
    x, u = dynamicsymbols("x u")
    model, start, numbers = da.compile_model(block(push=u)[0]), {"x": 0.0, "x_dot": 0.0}, {"m": 1.0, "mu": 0.5}
    turn = da.Event(x - 1, apply={x.diff(): -x.diff()})
    model.export(folder / "a", initial=start, parameters=numbers, t_span=(0, 2), events=[turn])


def write_events(folder):
    """Export a pendulum that strikes a stop."""
    model, start, numbers, events = pendulum()
    model.export(folder / "a", initial=start, parameters=numbers, t_span=(0, 2), method="taylor", events=events)


def write_units(folder):
    """Export a pendulum and a ball over a floor as units, without binaries, whose bytes are those of a compiler.

    The pendulum by implicit steps.
    """
    case = contact_motion("bouncing ball").motion
    model = da.compile_model(da.scenes.bouncing_ball(), outputs=["N"])
    given = {"t_span": (0, 2), "platforms": []}
    model.export(folder / "3.0.fmu", "fmu", fmi="3.0", initial=case.initial, parameters=case.parameters, **given)
    model, start, numbers, events = pendulum()
    given |= {"method": "radau", "events": events}
    model.export(folder / "2.0.fmu", "fmu", fmi="2.0", initial=start, parameters=numbers, **given)


def write_all(folder):
    """Make all exports, each in a folder of its own."""
    for writer in (write_contacts_with_inputs_and_events, write_events, write_units):
        own = folder / writer.__name__
        own.mkdir(parents=True)
        writer(own)


def write_elsewhere(folder, seed):
    """Make all exports in another process."""
    path = os.pathsep.join([str(Path(da.__file__).parents[1]), str(Path(__file__).parents[1])])
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": seed, "MALLOC_PERTURB_": MEMORY}
    code = f"from pathlib import Path; from export.test_equal_text import write_all; write_all(Path({str(folder)!r}))"
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)


def test_processes_write_the_same_bytes(tmp_path):
    """No address, hash or date of a process is in a file."""
    folders = here, elsewhere = tmp_path / "here", tmp_path / "elsewhere"
    write_all(here)
    write_elsewhere(elsewhere, "1" if os.environ.get("PYTHONHASHSEED") != "1" else "2")
    first, second = (
        {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        for folder in folders
    )
    assert len(first) == 2 * 6 + 2 and first.keys() == second.keys()
    assert [name for name in sorted(first) if first[name] != second[name]] == []
