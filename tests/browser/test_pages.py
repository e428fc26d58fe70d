"""Pages of animations in a browser: they load without errors, show something, and their slider moves the body."""

import time

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from browser.browsers import opened, told

Image = pytest.importorskip("PIL.Image")
pytest.importorskip("plotly")
GRAPH = "document.querySelector('.plotly-graph-div')"
TITLE = f"return {GRAPH}.layout.title.text"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    phi, theta = dynamicsymbols("phi theta")
    m, l = symbols("m l", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "Axis", (phi, N.z))
    B = A.orientnew("B", "Axis", (theta, A.x))
    G = O.locatenew("G", l * B.y)
    scene = da.Scene("arm", frame=N, origin=O, coordinates=[phi, theta])
    scene.add_bodies(RigidBody("arm", G, B, m, (inertia(B, 1, 1, 1), G)))
    scene.add_shapes({"arm": da.Box(x=0.2 * l, y=0.5 * l, z=0.1 * l, color="#ff0000"), "floor": da.Ground(N.z)})
    start = {phi: 0, theta: 0.5, phi.diff(): 1.5, theta.diff(): 0.3}
    motion = da.compile_model(scene, backend="numpy").simulate((0, 2), start, {m: 1, l: 1})
    path = tmp_path_factory.mktemp("pages") / "arm.html"
    motion.animate(fps=10).save(path)
    return path


@pytest.fixture(scope="module")
def browser(page):
    with opened(900, 700) as driver:
        driver.get(page.as_uri())
        deadline = time.monotonic() + 60
        while not driver.execute_script("return document.querySelectorAll('.gl-canvas, canvas').length"):
            assert time.monotonic() < deadline, "no canvas appeared"
            time.sleep(0.2)
        time.sleep(2.0)
        yield driver


def red_pixels(driver, path):
    """Return where the body is on the screen: rows and columns of its colour."""
    driver.save_screenshot(str(path))
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    return np.argwhere((picture[..., 0] > 150) & (picture[..., 1] < 110) & (picture[..., 2] < 110))


def slide(driver, share):
    """Click on the slider at a share of its length."""
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By

    rail = driver.find_element(By.CSS_SELECTOR, ".slider-rail-touch-rect")
    across = round((share - 0.5) * rail.size["width"])
    ActionChains(driver).move_to_element_with_offset(rail, across, 0).click().perform()
    time.sleep(1.5)


def test_the_page_loads_without_errors(browser):
    assert told(browser) == []


def test_the_slider_moves_the_body(browser, tmp_path):
    before = red_pixels(browser, tmp_path / "before.png")
    assert len(before) > 200, "the body is not visible"
    slide(browser, 0.9)
    after = red_pixels(browser, tmp_path / "after.png")
    assert len(after) > 200
    assert np.linalg.norm(after.mean(axis=0) - before.mean(axis=0)) > 20
    assert browser.execute_script(TITLE) != "t = 0.00 s"


def test_play_runs(browser):
    from selenium.webdriver.common.by import By

    slide(browser, 0.02)
    first = browser.execute_script(TITLE)
    browser.find_elements(By.CSS_SELECTOR, ".updatemenu-button")[0].click()
    deadline = time.monotonic() + 30
    while browser.execute_script(TITLE) == first:
        assert time.monotonic() < deadline, "the animation does not play"
        time.sleep(0.2)


def test_the_picture_follows_the_width_of_its_place(browser):
    """Sites and notebooks may settle it after the picture was drawn."""
    width = "return document.querySelector('.main-svg').getBoundingClientRect().width"
    browser.execute_script("document.querySelector('.plotly-graph-div').style.width = '420px'")
    deadline = time.monotonic() + 30
    while abs(browser.execute_script(width) - 420) > 1:
        assert time.monotonic() < deadline, "the picture keeps its width"
        time.sleep(0.2)
