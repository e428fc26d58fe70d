"""The pages of the site: they can be drawn, and their sliders are of values that they begin with."""

import sys
from pathlib import Path

import pytest

from dalembert.export import page
from export.pages import need_pages, parts
from export.test_pages import LARGEST

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

from live_pages import PAGES, written


@pytest.mark.parametrize("name", PAGES)
def test_pages_of_the_site(name, tmp_path, monkeypatch):
    monkeypatch.setattr(page, "web_assembly", lambda *_, **__: b"")
    described, _ = parts(written(PAGES[name], tmp_path / "page.html"))
    sliders = {given["name"]: given for given in described["given"] if "ends" in given}
    assert list(PAGES[name].sliders) == sorted(sliders, key=lambda slider: sliders[slider]["place"])
    assert all(low <= given["value"] <= high for given in sliders.values() for low, high in [given["ends"]])
    assert described["picture"]["shapes"]


@pytest.mark.matrix
@pytest.mark.parametrize("name", ["rocking_block", "stewart_platform"])
def test_long_pages_are_small_enough(tmp_path, name):
    need_pages()
    assert written(PAGES[name], tmp_path / "page.html").stat().st_size < LARGEST
