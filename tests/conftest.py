import gc
import os
from pathlib import Path

import pytest
from hypothesis import settings

from quick_kernels import compiled_quickly
from repeated_rows import WHOLE, repeated_in_products, repeats

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
gc.set_threshold(200_000, 20, 20)

# One process runs all tests of a file, so that it compiles a scene once. These files take longest and come first,
# so that no process is left with one of them when the others are done.
LONG = (
    "test_documents.py",
    "hard_cases/test_motions.py",
    "export/test_controllers.py",
    "test_gallery.py",
    "jax_backend/test_jax_pure.py",
    "codegen/test_numba_backend.py",
    "phases/test_common_program.py",
    "system/test_singular.py",
    "store/test_stored_sweeps.py",
    "jax_backend/test_jax_backend.py",
    "export/test_fmu.py",
    "export/test_events_beside_contacts.py",
    "fuzz/contacts/test_random_contacts.py",
    "loops/test_plain_loops.py",
    "export/test_python_files.py",
    "system/test_friction.py",
    "export/test_fmu_contacts.py",
    "jax_backend/test_jax_lanes.py",
    "scene/test_orientation.py",
    "system/test_redundant_loops.py",
    "export/test_events.py",
    "jax_backend/test_jax_foreign_batches.py",
    "system/test_grouped_loops.py",
    "mechanics/test_many_bodies.py",
    "fuzz/contacts/test_closed_forms.py",
    "contacts/test_points_of_one_link.py",
    "transforms/test_taylor.py",
    "jax_backend/test_jax_inputs.py",
    "jax_backend/test_jax_times.py",
    "export/test_c_simulators.py",
    "store/test_stored_refusals.py",
    "starts/test_invariant_projection.py",
    "jax_backend/test_jax_single.py",
    "export/test_fmu_events.py",
    "export/test_contact_simulators.py",
    "jax_backend/test_jax_results.py",
    "system/test_forces_at_limits.py",
    "system/test_contact_rounding.py",
    "export/test_time_conditions.py",
    "ir/test_text.py",
)


# Folders whose kernels are compiled with the options that users have: of the compiler, and of long runs.
USUAL = ("codegen", "corpus", "hard_cases", "jax_backend", "lanes", "loops", "methods", "steps", "subset", "transforms")


@pytest.fixture(scope="module", autouse=True)
def quick_kernels(request):
    """Compile the kernels of a file faster, to slower code of the same bits (`quick_kernels.compiled_quickly`).

    Tests compile much and run little. Files that stand in no folder, and runs for another instruction set, which are
    there for the code generator, have the usual options.
    """
    root = Path(__file__).parent
    if (
        request.path.parent == root
        or request.path.relative_to(root).parts[0] in USUAL
        or "DALEMBERT_TARGET" in os.environ
    ):
        yield
    else:
        with compiled_quickly():
            yield


@pytest.fixture
def small_heap():
    """Leave all that there is out of searches for garbage, for tests that start some: each takes a second or two."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module")
def quick_xla():
    """Compile the JAX programs of a file in a fraction of the time, to code that is slower (`jax_backend.jax_options`).

    For ``pytest.mark.usefixtures``. The gallery, tests that compare bits, and those of foreign calls leave XLA the
    options that users have.
    """
    try:
        from jax_backend.jax_options import compiled_quickly as programs_compiled_quickly
    except pytest.skip.Exception:  # there is no JAX
        yield
    else:
        with programs_compiled_quickly():
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


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(config, items):
    """Mark repetitions and order the files; of what options leave, keep the first tests where that is asked for."""
    root = Path(__file__).parent
    names = {path: path.relative_to(root).as_posix() for path in {item.path for item in items}}
    products = {}
    for item in items:
        parameters = item.callspec.params if hasattr(item, "callspec") else {}
        values = [value for value in parameters.values() if isinstance(value, str)]
        path = names[item.path]
        if repeats(path, item.name, values):
            item.add_marker("matrix")
        elif len(parameters) > 1 and path not in WHOLE and not item.get_closest_marker("matrix"):
            products.setdefault((item.path, item.originalname), {})[item] = parameters
    for rows in products.values():
        for item in repeated_in_products(rows):
            item.add_marker("matrix")
    places = {root / name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path, len(LONG)))
    yield
    if config.getoption("--first"):
        kept = {}
        for item in items:
            kept.setdefault(item.path, {}).setdefault(item.originalname, item)
        few = [item for tests in kept.values() for item in [*tests.values()][: config.getoption("--first")]]
        config.hook.pytest_deselected(items=[item for item in items if item not in few])
        items[:] = few
