"""The pages of the site: their scenes can be drawn, and their sliders are of values that they begin with."""

import sys
from pathlib import Path

import pytest

import dalembert as da
from dalembert.export.pictures import picture_of

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

from live_pages import PAGES


@pytest.mark.parametrize("name", PAGES)
def test_pages_of_the_site(name):
    live = PAGES[name]
    scene = live.scene()
    model = da.compile_model(scene, backend="numpy", outputs=live.outputs)
    values = {**live.initial, **live.parameters}
    assert set(live.parameters) == set(model.layout.parameters)
    assert all(low <= values[slider] <= high for slider, (low, high) in live.sliders.items())
    picture = picture_of(scene, live.parameters, model.layout)
    assert picture.description["shapes"] and picture.kernel.outputs
