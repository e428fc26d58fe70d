"""The pages of the worked examples are what the code gives."""

import importlib.util
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "docs" / "generate_examples.py"


@pytest.fixture(scope="module")
def generator():
    specification = importlib.util.spec_from_file_location("generate_examples", SCRIPT)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "name", ["13.4.2-corner-plate", "13.4.3-rolling-sphere", "13.4.4-edge-plate", "13.4.6-chaplygin-sleigh"]
)
def test_page_is_what_the_code_gives(generator, name):
    page = generator.BANNER + generator.PAGES[name]().rstrip() + "\n"
    assert (generator.FOLDER / f"{name}.md").read_text() == page


def test_every_page_is_generated(generator):
    assert sorted(p.stem for p in generator.FOLDER.glob("*.md")) == sorted(generator.PAGES)
