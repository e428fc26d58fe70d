"""Pages that simulate in a browser: numbers of `simulate`, pictures that follow the sliders, no network, no errors."""

import json
import time

import numpy as np
import pytest
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from browser.browsers import opened, told
from export.pages import need_pages

Image = pytest.importorskip("PIL.Image")
pytest.importorskip("selenium")

from selenium.webdriver import ActionChains, Keys  # noqa: E402

START, NUMBERS = {"a": 2.0, "b": 2.5, "a_dot": 0, "b_dot": 0}, {"m": 1, "l": 1, "g": 9.81}
SPAN, TOLERANCES = (0, 4), {"rtol": 1e-10, "atol": 1e-12}
READY = "return Boolean(window.simulation && simulation.state.run.done && simulation.state.finer.known > 1)"
ROW = """
const { state, timeAt } = simulation, { run } = state, k = arguments[0];
return [timeAt(k), ...run.rows.subarray(k * run.width, k * run.width + 4)];
"""


@pytest.fixture(scope="module")
def model():
    a, b = dynamicsymbols("a b")
    m, l, g = symbols("m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", l * sin(a) * N.x - l * cos(a) * N.y)
    Q = P.locatenew("Q", l * sin(b) * N.x - l * cos(b) * N.y)
    scene = da.Scene("double_pendulum", frame=N, origin=O, coordinates=[a, b])
    scene.add_bodies(Particle("upper", P, m), Particle("lower", Q, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_shapes({"rods": [da.Rod(O, P), da.Rod(P, Q)], "lower": da.Sphere(l / 5, color="#ff0000")})
    return da.compile_model(scene)


@pytest.fixture(scope="module")
def browser(model, tmp_path_factory):
    need_pages()
    with opened(1200, 900) as driver:
        path = tmp_path_factory.mktemp("pages") / "pendulum.html"
        model.export(path, "page", initial=START, parameters=NUMBERS, t_span=SPAN, **TOLERANCES)
        driver.get(path.as_uri())
        wait(driver, READY)
        driver.execute_script("simulation.play(false)")
        yield driver


def wait(driver, question, *arguments):
    deadline = time.monotonic() + 60
    while not driver.execute_script(question, *arguments):
        assert time.monotonic() < deadline, question
        time.sleep(0.05)


def place_of_the_sphere(driver, path):
    """Return the middle of the red sphere on the screen: row and column."""
    time.sleep(0.4)
    driver.save_screenshot(str(path))
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)[:620, :780]
    found = np.argwhere((picture[..., 0] > 130) & (picture[..., 1] < 60) & (picture[..., 2] < 60))
    assert len(found) > 300, "the sphere is not visible"
    return np.median(found, axis=0)


def slider(driver, name):
    return driver.find_element("css selector", f'input[type="range"][data-name="{name}"]')


def test_numbers_are_those_of_simulate(browser, model):
    count = browser.execute_script("return simulation.state.run.known")
    rows = np.array([browser.execute_script(ROW, k) for k in (0, count // 3, count - 1)])
    run = model.simulate(SPAN, START, NUMBERS, t_eval=rows[:, 0], **TOLERANCES)
    for place, name in enumerate(model.layout.variables, 1):
        np.testing.assert_allclose(rows[:, place], run[name], rtol=1e-10, atol=1e-10)


def test_nothing_comes_from_a_network_and_the_console_is_empty(browser):
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    asked = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
    assert [url.split(":")[0] for url in asked if not url.startswith("data:,")] == ["file"]
    assert told(browser) == []


def test_the_picture_follows_a_slider_while_it_is_dragged(browser, model, tmp_path):
    """Before it is let go, the picture and the numbers are those of the value under the pointer."""
    count = browser.execute_script("return simulation.state.run.known")
    browser.execute_script("simulation.seek(arguments[0])", count // 3)
    before = place_of_the_sphere(browser, tmp_path / "before.png")
    handle = slider(browser, "a")
    actions = ActionChains(browser, duration=50)
    share = (2.0 + 3.1416) / 6.2832 - 0.5
    actions.move_to_element_with_offset(handle, round(share * (handle.size["width"] - 16)), 0).click_and_hold()
    actions.move_by_offset(-25, 0).perform()
    assert browser.execute_script("return simulation.state.dragging")
    wait(browser, "return simulation.state.run.done && !simulation.state.stale")
    value = browser.execute_script("return simulation.values[simulation.names.indexOf('a')]")
    assert value < 1.9
    dragged = place_of_the_sphere(browser, tmp_path / "dragged.png")
    assert np.linalg.norm(dragged - before) > 15
    t, a, *_ = browser.execute_script(ROW, count // 3)
    run = model.simulate(SPAN, {**START, "a": value}, NUMBERS, t_eval=[t], **TOLERANCES)
    assert a == pytest.approx(run["a"][0], rel=1e-10)
    ActionChains(browser, duration=50).move_by_offset(-10, 0).release().perform()
    wait(browser, READY + " && !simulation.state.dragging")
    browser.find_element("id", "reset").click()
    wait(browser, READY + " && simulation.values[0] === 2")


def test_playing_and_the_time_slider_move_the_picture(browser, tmp_path):
    browser.execute_script("simulation.seek(0)")
    first = place_of_the_sphere(browser, tmp_path / "first.png")
    browser.find_element("id", "play").click()
    wait(browser, "return simulation.state.cursor > 60")
    browser.find_element("id", "play").click()
    assert not browser.execute_script("return simulation.state.playing")
    later = place_of_the_sphere(browser, tmp_path / "later.png")
    assert np.linalg.norm(later - first) > 15
    assert browser.find_element("id", "clock").text != "0.00 s"
    browser.find_element("id", "scrub").send_keys(Keys.END)
    wait(browser, "return document.getElementById('clock').textContent === '4.00 s'")
    assert browser.execute_script("return simulation.state.cursor === simulation.state.run.known - 1")


def test_dragging_the_picture_turns_it(browser, tmp_path):
    browser.execute_script("simulation.seek(0)")
    before = place_of_the_sphere(browser, tmp_path / "before.png")
    picture = browser.find_element("id", "picture")
    ActionChains(browser, duration=50).drag_and_drop_by_offset(picture, 120, 0).perform()
    assert np.linalg.norm(place_of_the_sphere(browser, tmp_path / "turned.png") - before) > 15
    browser.find_element("id", "fit").click()
    wait(browser, "return !simulation.view.wish")
    assert np.linalg.norm(place_of_the_sphere(browser, tmp_path / "home.png") - before) < 4


def test_values_that_cannot_run_are_told_and_typed_ones_are_taken(browser):
    number = slider(browser, "l").find_element("xpath", "following-sibling::input")
    number.send_keys(Keys.CONTROL, "a")
    number.send_keys("-1\n")
    wait(browser, "return !document.getElementById('fault').hidden")
    assert "declared to be" in browser.find_element("id", "fault").text
    number.send_keys(Keys.CONTROL, "a")
    number.send_keys("0.5\n")
    wait(browser, READY + " && document.getElementById('fault').hidden")
    assert browser.execute_script("return simulation.values.includes(0.5)")


def test_quantities_are_chosen_and_a_click_on_a_curve_is_a_time(browser):
    figures = len(browser.find_elements("css selector", "figure"))
    chip = browser.find_element("css selector", '#chips button[title="b_dot"]')
    chip.click()
    assert len(browser.find_elements("css selector", "figure")) == figures - 1
    chip.click()
    canvas = browser.find_element("css selector", "figure canvas")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
    ActionChains(browser, duration=50).move_to_element(canvas).click().perform()
    share = browser.execute_script("return simulation.state.cursor / (simulation.state.run.known - 1)")
    assert 0.3 < share < 0.7
    assert told(browser) == []


def test_a_narrow_window_needs_no_sideways_scrolling(browser):
    for width in (360, 1200):
        size = {"width": width, "height": 780, "deviceScaleFactor": 2, "mobile": width < 500}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        wait(browser, f"return document.documentElement.scrollWidth <= {width}")
        assert browser.find_element("id", "picture").size["width"] <= width
