"""The order in which packages import one another, and the absence of circles among modules."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import dalembert

PACKAGE = Path(dalembert.__file__).parent
BASIC = {"arrays", "errors", "frozen", "naming", "once", "options", "progress", "threads", "values", "version"}
ORDER = [
    "ir",
    "methods",
    "subset",
    "transforms",
    "scene",
    "scenes",
    "textbook",
    "mechanics",
    "interop",
    "reduction",
    "lowering",
    "stops",
    "steps",
    "lanes",
    "events",
    "loops",
    "contacts",
    "codegen",
    "jax",
    "pipeline",
    "results",
    "starts",
    "runs",
    "analysis",
    "phases",
    "store",
    "export",
    "model",
    "compiler",
]
"""Packages and modules at the top, each of which imports only what stands before it."""

EXCEPTIONS = {
    ("scene.scene", "interop.sympy_systems"),
    ("scene.robots", "interop.mjcf"),
    ("scene.robots", "interop.urdf"),
    ("lanes.cases", "events.event_code"),
    ("codegen", "jax.backend"),
    ("stops.samples", "jax.runs.precision"),
    ("runs.prepare", "phases.given_values"),
    ("runs.sweep", "phases.given_values"),
}
"""`Scene.from_sympy` and so on make scenes by what comes after scenes; cases with contacts may be sweeps of their
modes; the others name types, and arrays of JAX."""

MODEL = "model.model"
"""What functions over a model may import where only type checkers see it: the name of its type."""

Import = tuple[str, str, bool]


def _modules() -> dict[str, Path]:
    found = {}
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = _modules()


@cache
def _nodes(name: str) -> list[ast.AST]:
    """Return the syntax tree of a module as a list."""
    return [*ast.walk(ast.parse(MODULES[name].read_text(encoding="utf-8")))]


def _imports(name: str) -> set[Import]:
    """Return what a module imports of the package: (module, imported module, only for type checkers)."""
    path = MODULES[name]
    nodes = _nodes(name)
    checked = {
        id(inner)
        for node in nodes
        if isinstance(node, ast.If) and any("TYPE_CHECKING" in vars(part).values() for part in ast.walk(node.test))
        for inner in ast.walk(node)
    }
    found = set()
    for node in nodes:
        if not isinstance(node, ast.ImportFrom):
            continue
        if node.level:
            base = name.split(".") if name else []
            base = base if path.name == "__init__.py" else base[:-1]
            base = base[: len(base) - (node.level - 1)]
            target = ".".join([*base, *(node.module.split(".") if node.module else [])])
        elif (node.module or "").split(".")[0] == "dalembert":
            target = ".".join((node.module or "").split(".")[1:])
        else:
            continue
        for alias in node.names:
            whole = f"{target}.{alias.name}".lstrip(".")
            found.add((name, whole if whole in MODULES else target, id(node) in checked))
    return found


@cache
def _all_imports() -> frozenset[Import]:
    """Return the imports of all modules, which are read once, and only where a test asks for them."""
    return frozenset(one for name in MODULES if name for one in _imports(name))


def _package(module: str) -> str:
    return module.split(".")[0]


def test_every_package_has_its_place():
    assert {_package(name) for name in MODULES if name} <= BASIC | set(ORDER)


def test_packages_import_only_what_stands_before_them():
    wrong = []
    for module, target, checked in sorted(_all_imports()):
        importer, imported = _package(module), _package(target)
        if importer == imported or (module, target) in EXCEPTIONS or (checked and target == MODEL):
            continue
        if target == "" or (importer in BASIC and imported not in BASIC):
            wrong.append(f"{module} imports {target or 'dalembert'}")
        elif imported not in BASIC and ORDER.index(imported) > ORDER.index(importer):
            wrong.append(f"{module} imports {target}")
    assert not wrong


def test_no_modules_import_one_another_in_a_circle():
    """Imports that only type checkers see are left out: they name types in annotations."""
    following: dict[str, set[str]] = {name: set() for name in MODULES}
    for module, target, checked in _all_imports():
        if not checked and (module, target) not in EXCEPTIONS and module != target:
            following[module].add(target)
    done: set[str] = set()

    def visit(name: str, path: list[str]) -> None:
        if name in path:
            pytest.fail(" -> ".join([*path[path.index(name) :], name]))
        if name in done:
            return
        for other in sorted(following[name]):
            visit(other, [*path, name])
        done.add(name)

    for name in sorted(following):
        visit(name, [])


def test_the_order_is_that_of_the_design_page():
    text = (PACKAGE.parents[1] / "docs" / "design.md").read_text(encoding="utf-8")
    section = text[text.index("## Packages") : text.index("## Decisions")]
    assert [line.split("`")[1] for line in section.splitlines() if line.startswith("| `")] == ORDER


def test_a_scene_without_contacts_imports_no_code_of_contacts_or_sweeps_and_no_numba():
    script = (
        "import sys, dalembert as da; da.compile_model(da.scenes.chaplygin_sleigh());"
        "unneeded = {'numba', 'jax', 'scipy.integrate', 'dalembert.contacts', 'dalembert.codegen.numba'};"
        "unneeded |= {f'dalembert.{name}' for name in ('phases', 'runs.sweep', 'analysis', 'store')};"
        "print(sorted(unneeded & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def _root(node: ast.AST) -> str | None:
    """Return the name with which an expression such as ``jax.jit(f).lower`` begins."""
    while (inner := getattr(node, "value", getattr(node, "func", None))) is not None:
        node = inner
    return getattr(node, "id", None)


def _of_jax(name: str) -> set[str]:
    """Return the dotted names of JAX that a module imports or reads."""
    found = set()
    for node in _nodes(name):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Attribute) and _root(node) == "jax":
            found.add(ast.unparse(node))
    return {name for name in found if name.split(".")[0] == "jax"}


def test_of_jax_only_the_public_interface_is_used():
    """What is private, or an operation of our own, stops working with the next version of JAX."""
    private = ("jax.interpreters", "jax.extend", "jax.core", "jax.lib", "jaxlib")
    wrong = {
        (name, used)
        for name, path in MODULES.items()
        if "jax" in path.read_text(encoding="utf-8")
        for used in _of_jax(name)
        if any(part.startswith("_") and not part.startswith("__") for part in used.split("."))
        or (used.startswith(private) and used not in ("jax.core", "jax.core.Tracer"))
    }
    assert not wrong
    assert "jax.core.Tracer" in _of_jax("jax.runs.precision")  # names are found at all
