"""The benchmarks: what they compare is right, and their tables say what was measured."""

import inspect
import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dalembert.codegen import BACKENDS
from dalembert.codegen.llvm.target import available_targets

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

import before_after  # noqa: E402
import hard_case_pages  # noqa: E402
import lesser_processors  # noqa: E402
import overhead  # noqa: E402
import published_peers  # noqa: E402
import report  # noqa: E402
import robots  # noqa: E402
import saved_tables  # noqa: E402
import sweeps  # noqa: E402
import tables  # noqa: E402
from batches import BATCHES, SAMPLE, sample_states  # noqa: E402
from cases import PROBLEMS  # noqa: E402
from contenders import BACKEND_ORDER, available_backends  # noqa: E402
from peer_settings import MARKERS  # noqa: E402
from peers import compiled_rhs, scipy_ode  # noqa: E402
from sweeps import SweepContender, _within_limit, own_sweep  # noqa: E402

from hard_cases import CASES  # noqa: E402
from hard_cases.contacts import CONTACT_CASES  # noqa: E402


def test_every_backend_of_the_registry_is_measured_in_one_order():
    found, missing = available_backends()
    assert len(found) + len(missing) == len(BACKENDS)
    assert found == [name for name in BACKEND_ORDER if name in found]


@pytest.mark.parametrize("name", PROBLEMS)
def test_compiled_equations_of_peers_are_those_written_by_hand(name):
    reduced = PROBLEMS[name].reduced
    state = reduced.start + 0.1
    by_hand = reduced.rhs(state.tolist(), reduced.parameters, (math.sin, math.cos))
    np.testing.assert_allclose(compiled_rhs(reduced)(0.0, state, reduced.parameters), by_hand, rtol=1e-14)


def test_a_peer_is_accurate():
    assert scipy_ode(PROBLEMS["sleigh"], 1e-9).error < 1e-8


@pytest.mark.parametrize("name", BATCHES)
def test_sweeps_end_in_the_exact_states(name):
    batch = BATCHES[name](SAMPLE)
    _, sample, _ = own_sweep(batch, "taylor", 1, 1e-10)
    np.testing.assert_allclose(sample(), sample_states(batch), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", overhead.SCENES)
def test_the_overhead_is_the_call_less_its_compiled_loop(name):
    found = overhead.overhead(name, PROBLEMS[name], rounds=2)
    assert 0.0 < found.loop < found.called and found.beyond == found.called - found.loop and found.steps > 5
    assert f"| {name} | {found.steps} |" in overhead.table([found])
    for work in ("", "with an event"):
        swept = overhead.sweep_overhead(name, PROBLEMS[name], rounds=2, work=work)
        assert swept.case < swept.called and f"| {name} {work}".rstrip() in overhead.sweep_table([swept])
    assert overhead.second_thread(PROBLEMS[name], rounds=2) > 0.0
    assert overhead.waking_thread(rounds=2) > 0.0


def test_a_slow_contender_takes_fewer_cases_at_this_and_tighter_tolerances(monkeypatch):
    monkeypatch.setattr(sweeps, "_seconds", lambda solver: solver)
    contender = SweepContender("slow", lambda batch, rtol: 9.0 if batch == 100 and rtol < 1e-5 else 0.1, limit=1.0)
    done = [(rtol, count) for rtol, count, _ in _within_limit(contender, (1e-5, 1e-6, 1e-7), {100: 100, 10: 10})]
    assert done == [(1e-5, 100), (1e-6, 10), (1e-7, 10)]


def record(label, rtol, error, us, cases=100):
    return {"scene": "sleigh", "label": label, "rtol": rtol, "error": error, "us": {"median": us}, "cases": cases}


def test_tables_mark_fewer_cases_and_read_times_at_equal_error():
    records = [record("dalembert llvm taylor, 2 threads", 1e-6, 1e-6, 2.0)]
    records.append(record("diffrax Dopri8", 1e-6, 1e-6, 8.0, cases=10))
    (own, _), (theirs, cell) = ([row[0], row[1]] for row in tables.ratio_rows(records, "sweep", records[0]["label"]))
    assert (own, theirs, cell) == ("sleigh: dalembert llvm taylor, 2 threads", "sleigh: diffrax Dopri8 *", "8.0 (4x)")
    assert tables.fewer_cases(records) == ["\\* with 10 cases, because a call with 100 takes too long."]
    assert tables.fewer_cases(records[:1]) == []


def test_a_program_is_one_column_by_its_fastest_method():
    labels = {"dalembert llvm taylor": 2.0, "dalembert llvm tsit5": 4.0, "diffrax Tsit5": 12.0, "diffrax Dopri8": 8.0}
    records = [record(label, report.SHOWN, report.SHOWN, us) for label, us in labels.items()]
    head, _, line = report.fastest_table(records, "sweep", "dalembert llvm taylor").splitlines()
    cells = dict(zip(head.split(" | "), line.split(" | "), strict=True))
    assert (cells["llvm"], cells["diffrax"], cells["heyoka"]) == ("2.0 (1x)", "8.0 (4x)", "-")
    assert line.startswith("| sleigh | ")


def test_pages_hold_the_markers_that_reports_fill():
    assert all((ROOT / "docs/benchmarks.md").read_text().count(marker) == 1 for marker in (report.BEGIN, report.END))
    assert all((ROOT / "docs/peer_settings.md").read_text().count(marker) == 1 for marker in MARKERS)


def test_a_robot_is_one_line_with_pairs_of_a_fixed_and_a_floating_base():
    fixed = {"name": "a", "floating": False, "links": 4, "bodies": 2, "coordinates": 2, "read": 0.1, "compile": 1.0}
    fixed |= {"error": 1e-15, "residual": 2e-16}
    floating = fixed | {"floating": True, "bodies": 3, "coordinates": 9, "compile": 2.0, "error": 3e-15}
    alone = floating | {"name": "b", "bodies": 1, "coordinates": 7}
    refused = [{"name": "b", "floating": False, "refused": "nothing moves"}]
    refused += [{"name": "c", "floating": base, "refused": "no links"} for base in (False, True)]
    _, *rows = saved_tables.cells(robots.table([fixed, floating, refused[0], alone, *refused[1:]]))
    assert rows == [
        ["a", "4", "2", "2", "0.10, 0.10", "1.00, 2.00", "1e-15, 3e-15", "2e-16, 2e-16", ""],
        ["b", "4", "0", "0", "-, 0.10", "-, 2.00", "-, 3e-15", "-, 2e-16", "fixed base: nothing moves"],
        ["c", "", "", "", "", "", "", "", "fixed and floating base: no links"],
    ]
    count, names, faults = saved_tables.robots(rows).split("\n\n")
    assert count.startswith("3 files: 2 load and compile, 1 raise") and "3e-15 relative" in count
    assert names == "Read: a, b."
    assert faults == "- b, fixed base: nothing moves\n- c, fixed and floating base: no links"


@pytest.mark.parametrize("name", saved_tables.SHOWN)
def test_parts_of_pages_are_those_of_their_tables(name):
    """If one is not: ``python benchmarks/saved_tables.py``."""
    begin, end = saved_tables.markers(name)
    _, found = (ROOT / "docs" / f"{saved_tables.SHOWN[name].page}.md").read_text().split(begin)
    assert found.split(end)[0].strip() == saved_tables.part(name)


def test_before_and_after_are_one_line_with_medians_minima_and_ratios():
    samples = {"run": {"old": [2e-6, 4e-6, 3e-6], "new": [1e-6, 6e-6, 3e-6]}}
    assert list(before_after.rows_of("prepared run", samples, "us")) == [
        "| prepared run: run [us] | 3.00 | 3.00 | 2.00 | 1.00 | 1.00 | 0.50 |"
    ]


def test_pages_of_hard_cases_are_those_of_their_data():
    data = hard_case_pages.load()
    assert hard_case_pages.DATA.read_text() == hard_case_pages.dump(data)
    assert (ROOT / "docs/hard_cases.md").read_text() == hard_case_pages.overview(data)
    assert (ROOT / "docs/hard_cases_details.md").read_text() == hard_case_pages.details(data)


@pytest.mark.parametrize(("group", "known"), [("cases", CASES), ("contacts", CONTACT_CASES)])
def test_data_of_hard_cases_are_of_cases_that_there_are(group, known):
    for name, case in hard_case_pages.load()[group].items():
        assert case["hard"] == " ".join(inspect.getdoc(known[name]).split())


def test_runs_that_another_one_beats_are_left_out_of_the_picture():
    runs = [
        {"ms": ms, "error": error} for ms, error in ((2.0, 1e-6), (1.0, 1e-3), (1.5, 1e-2), (3.0, 1e-6), (4.0, 1e-9))
    ]
    assert published_peers.fastest(runs) == [runs[1], runs[0], runs[4]]


@pytest.mark.parametrize("method", ["ours", "scipy_run", "sundials_run", "diffrax_run"])
def test_solvers_beside_ours_solve_the_same_motion(method):
    pytest.importorskip({"sundials_run": "casadi", "diffrax_run": "diffrax"}.get(method, "numpy"))
    task = published_peers.Task("IFToMM A01, pendulum")
    names = {"ours": "auto", "scipy_run": "dop853", "sundials_run": "Adams", "diffrax_run": "Dopri8"}
    run = getattr(published_peers, method)(task, names[method], 1e-10)
    assert task.error(run()) < 1e-6


FOUND = """
from llvmlite import binding
has = binding.get_host_cpu_features()
print(binding.get_host_cpu_name(), has["sse4.2"], has["avx2"], has["avx512f"])
"""


@pytest.mark.skipif(sys.platform != "linux" or shutil.which("cc") is None, reason="no Linux, or no C compiler")
@pytest.mark.parametrize(("target", "found"), [("x86-64-v2", "nehalem 1 0 0"), ("x86-64-v3", "haswell 1 1 0")])
def test_programs_of_a_process_find_a_lesser_processor(target, found):
    if target not in available_targets():
        pytest.skip(f"this processor is no {target}")
    try:
        said = lesser_processors.output_on(target, ["-c", FOUND])
    except subprocess.CalledProcessError as reason:
        if reason.returncode != lesser_processors.CANNOT_HIDE:
            raise
        pytest.skip("CPUID does not fault on this processor")
    assert said.replace("True", "1").replace("False", "0").split() == found.split()
