"""The way from a call of `simulate` or `sweep` to the compiled loop is the one that the design page shows."""

import re
import sys
from pathlib import Path

import pytest

import dalembert as da

ROOT = Path(da.__file__).parent
PAGE = (Path(__file__).parents[2] / "docs" / "design.md").read_text()
START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
PARAMETERS = {"m": 1.0, "b": 0.3, "I_C": 0.5}
LAST = {"simulate": ("loops.taylor_runs", "integrate"), "sweep": ("codegen.llvm.sweep_memory", "work")}


def frames_to(last, run):
    """Return module and function of the frames of this package that lead to the last of them, in the order of calls."""
    found = []

    def look(frame, event, _):
        if event == "call" and not found and place(frame) == last:
            while frame is not None:
                if place(frame) is not None:
                    found.insert(0, place(frame))
                frame = frame.f_back

    sys.setprofile(look)
    try:
        run()
    finally:
        sys.setprofile(None)
    return found


def place(frame):
    path = Path(frame.f_code.co_filename)
    if ROOT not in path.parents:
        return None
    return ".".join(path.relative_to(ROOT).with_suffix("").parts), frame.f_code.co_name


def shown(what):
    """Return the frames that the page shows."""
    (block,) = re.findall(rf"```text\n(model\.{what}\n.*?)```", PAGE, re.DOTALL)
    return [tuple(line.split()[:2]) for line in block.splitlines()[1:]]


@pytest.mark.parametrize("what", ["simulate", "sweep"])
def test_from_a_call_to_the_loop(what):
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    runs = {
        "simulate": lambda: model.simulate((0, 1), START, PARAMETERS, method="taylor"),
        "sweep": lambda: model.sweep((0, 1), START, {**PARAMETERS, "b": [0.3, 0.4]}, method="taylor", threads=1),
    }
    runs[what]()
    frames = frames_to(LAST[what], runs[what])
    assert frames[0] == ("errors", "call")  # names expressions that are nested too deeply
    assert frames[1:] == shown(what)
    assert len(frames[1:]) <= 6 and len({module for module, _ in frames[1:]}) <= 4
