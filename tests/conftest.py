import gc
import os
from pathlib import Path

import pytest
from hypothesis import settings

from repeated_rows import repeats

os.environ.setdefault("MPLBACKEND", "Agg")
# SymPy remembers a thousand results of each function, and derives a fifth faster where it remembers more.
os.environ.setdefault("SYMPY_CACHE_SIZE", "20000")
# The first example of a property compiles a model, so that no deadline fits all of them.
# The same code has the same examples; `pytest --hypothesis-profile=random` draws others.
settings.register_profile("dalembert", deadline=None, derandomize=True)
settings.register_profile("random", deadline=None, print_blob=True)
settings.load_profile("dalembert")

# Expressions, graphs and traces are many objects in few cycles: with the thresholds that Python sets, a tenth of the
# time of the tests is spent on looking for garbage.
gc.set_threshold(50_000, 20, 20)

# One process runs all tests of a file, so that it compiles a scene once. These files take longest and come first,
# so that no process is left with one of them when the others are done.
LONG = (
    "textbook/test_agreement.py",
    "test_gallery.py",
    "jax_backend/test_jax_pure.py",
    "jax_backend/test_jax_derivatives.py",
    "events/test_events.py",
    "fuzz/contacts/test_random_contacts.py",
    "jax_backend/test_jax_devices.py",
    "jax_backend/test_jax_lanes.py",
    "system/test_friction.py",
    "store/test_stored_sweeps.py",
    "hard_cases/test_motions.py",
    "test_documents.py",
    "codegen/test_numba_backend.py",
    "jax_backend/test_jax_backend.py",
    "jax_backend/test_jax_times.py",
    "jax_backend/test_jax_second.py",
    "jax_backend/test_jax_hosted.py",
    "jax_backend/test_jax_foreign_batches.py",
    "codegen/test_loops.py",
    "system/test_switch_departures.py",
    "system/test_knot_starts.py",
    "jax_backend/test_jax_single.py",
    "scene/test_orientation.py",
    "textbook/test_pages.py",
    "textbook/test_example_13_4_6.py",
    "system/test_singular.py",
    "codegen/test_rendering.py",
    "test_packaging.py",
    "jax_backend/test_jax_agreement.py",
    "jax_backend/test_jax_inputs.py",
    "jax_backend/test_jax_jumps.py",
    "starts/test_invariant_projection.py",
    "hard_cases/test_contacts.py",
    "analysis/test_sensitivity.py",
    "hard_cases/test_long_runs.py",
)


@pytest.fixture(scope="module")
def quick_xla():
    """Compile the JAX programs of a file in a fraction of the time, to code that is slower (`jax_backend.jax_options`).

    For ``pytest.mark.usefixtures``. The documents, the gallery, tests that compare bits, and those of calls that are
    eager or foreign leave XLA the options that users have.
    """
    try:
        from jax_backend.jax_options import compiled_quickly
    except pytest.skip.Exception:  # there is no JAX
        yield
    else:
        with compiled_quickly():
            yield


@pytest.hookimpl(optionalhook=True)
def pytest_handlecrashitem(crashitem, report, sched):
    """End the run: pytest-xdist can wait for ever for the process that it puts in the place of one that crashed."""
    pytest.exit(f"a process crashed, or ran into faulthandler_timeout, in {crashitem}", returncode=1)


def pytest_collection_finish():
    """Leave what every test needs, modules and the tests themselves, out of all later searches for garbage."""
    gc.collect()
    gc.freeze()


def pytest_sessionfinish():
    """Leave all that there is out of the searches for garbage with which pytest ends: ten seconds of each process."""
    gc.freeze()


def pytest_addoption(parser):
    parser.addoption("--first", type=int, metavar="N", help="run the first N tests of each file, for their first cases")


def pytest_collection_modifyitems(config, items):
    if config.getoption("--first"):
        kept = {}
        for item in items:
            kept.setdefault(item.path, {}).setdefault(item.originalname, item)
        few = [item for tests in kept.values() for item in [*tests.values()][: config.getoption("--first")]]
        config.hook.pytest_deselected(items=[item for item in items if item not in few])
        items[:] = few
    root = Path(__file__).parent
    for item in items:
        values = item.callspec.params.values() if hasattr(item, "callspec") else ()
        if repeats(
            item.path.relative_to(root).as_posix(), item.name, [value for value in values if isinstance(value, str)]
        ):
            item.add_marker("matrix")
    places = {root / name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path, len(LONG)))
