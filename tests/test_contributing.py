"""What CONTRIBUTING.md adds works when it is added as shown, and not without it."""

import importlib
import re
import sys
import types
from pathlib import Path

import pytest

import dalembert as da

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "CONTRIBUTING.md").read_text()
PREAMBLE, *SECTIONS = re.split(r"^## ", PAGE, flags=re.M)
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.M | re.S)
PLACE = re.compile(r"# src/(dalembert/\S+)\.py\n")
REFUSED = (AssertionError, ImportError, da.errors.DalembertError)
KINDS = ["A method", "A check of a run", "A kind of stop", "A contact law", "A formulation", "A backend", "An export"]


class Additions:
    """Code that is added to modules, until it is taken away."""

    def __init__(self):
        self.changed, self.new = {}, []

    def add(self, place, code):
        name = place.removesuffix("/__init__").replace("/", ".")
        if (ROOT / "src" / f"{place}.py").exists():
            module = importlib.import_module(name)
            if module not in self.changed:
                tables = {key: dict(value) for key, value in vars(module).items() if type(value) is dict}
                self.changed[module] = dict(vars(module)), tables
        else:
            module = types.ModuleType(name)
            module.__package__, module.__file__ = name.rpartition(".")[0], f"{place}.py"
            parent, _, own = name.rpartition(".")
            setattr(importlib.import_module(parent), own, module)
            sys.modules[name] = module
            self.new.append((parent, own))
        exec(compile(code, f"{place}.py", "exec"), vars(module))

    def remove(self):
        for module, (names, tables) in self.changed.items():
            added = set(vars(module)) - set(names)
            for key in added - {key for key in added if isinstance(vars(module)[key], types.ModuleType)}:
                delattr(module, key)
            vars(module).update(names)
            for key, table in tables.items():
                value = getattr(module, key)
                value.clear()
                value.update(table)
        for parent, own in self.new:
            del sys.modules[f"{parent}.{own}"]
            sys.modules[parent].__dict__.pop(own, None)
        self.changed, self.new = {}, []


@pytest.fixture
def additions():
    made = Additions()
    yield made
    made.remove()


def blocks(section):
    """Return the blocks of a section: those with the place of a module, and the others."""
    added, used = [], []
    for code in BLOCK.findall(section):
        place = PLACE.match(code)
        if place:
            added.append((place[1], code))
        else:
            used.append(code)
    return added, used


def use(code):
    names = {}
    for block in (*BLOCK.findall(PREAMBLE), code):
        exec(compile(block, "CONTRIBUTING.md", "exec"), names)


def test_every_kind_has_its_section():
    assert [section.splitlines()[0] for section in SECTIONS] == KINDS


@pytest.mark.parametrize("section", SECTIONS, ids=lambda section: section.splitlines()[0])
def test_what_is_added_works_as_shown(section, additions):
    added, used = blocks(section)
    assert added and len(used) == 1
    for place, code in added:
        additions.add(place, code)
    use(used[0])
    additions.remove()
    with pytest.raises(REFUSED):
        use(used[0])


def test_the_files_that_the_page_names_exist():
    added = {f"{place.removeprefix('dalembert/')}.py" for section in SECTIONS for place, _ in blocks(section)[0]}
    prose = re.sub(r"^```.*?^```$", "", PAGE, flags=re.M | re.S)
    named = set(re.findall(r"`([\w/]+\.py)`", prose))
    tests = {path.name for path in (ROOT / "tests").rglob("test_*.py")}
    assert len(named) > 20 and len(added) > 6
    for name in named - {"tests/test_contributing.py"}:
        assert name in tests or (ROOT / "src" / "dalembert" / name).exists(), name
