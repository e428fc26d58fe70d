"""Robots of many links, whose numbers are decimals: no pivot of theirs counts as zero by the bound of its rounding."""

import numpy as np
import pytest
from sympy.physics.mechanics import Point, ReferenceFrame

import dalembert as da
from oracles.chain_recursion import planar_chain

LINKS = 50
LENGTH, MASS, MOMENT = 0.5, 1.0, 0.02


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """Return a URDF file of equal rods, one after the other, in a vertical plane."""
    centre = f'<origin xyz="{LENGTH / 2} 0 0"/><mass value="{MASS}"/>'
    moments = f'<inertia ixx="0.01" iyy="{MOMENT}" izz="{MOMENT}" ixy="0" ixz="0" iyz="0"/>'
    parts = ['<link name="l0"/>']
    for i in range(LINKS):
        place = f'<origin xyz="{LENGTH if i else 0} 0 0"/><axis xyz="0 1 0"/>'
        ends = f'<parent link="l{i}"/><child link="l{i + 1}"/>'
        parts.append(f'<link name="l{i + 1}"><inertial>{centre}{moments}</inertial></link>')
        parts.append(f'<joint name="q{i}" type="continuous">{ends}{place}</joint>')
    path = tmp_path_factory.mktemp("robots") / "chain.urdf"
    path.write_text(f'<robot name="chain">{"".join(parts)}</robot>')
    return path


@pytest.fixture(scope="module")
def model(robot):
    """Return the model of the file."""
    return da.compile_model(da.Scene.from_urdf(robot))


def test_accelerations_balance_the_loads(model):
    """Turns about the y axis, which points into the plane, are those of the recursion with the other sign."""
    rng = np.random.default_rng(3)
    q, qdot = rng.uniform(-1, 1, LINKS), rng.uniform(-1, 1, LINKS)
    found = model.accelerations(0.0, q, qdot, {})
    equal = np.ones(LINKS)
    terms = planar_chain(-q, -qdot, MASS * equal, LENGTH * equal, MOMENT * equal, 9.81)
    sizes = np.abs(terms.mass_matrix) @ np.abs(found) + np.abs(terms.forcing)
    assert np.max(np.abs(terms.mass_matrix @ -found - terms.forcing) / sizes) < 1e-13


def test_scenes_are_built_without_searches_among_all_links(robot, monkeypatch):
    """SymPy looks for ways among all frames and points that are joined; such searches made a thousand links cubic."""
    searches = []

    def counted(kind, name, joined):
        search = getattr(kind, name)

        def wrapper(self, *args):
            if getattr(self, joined):
                searches.append(self.name)
            return search(self, *args)

        monkeypatch.setattr(kind, name, wrapper)

    counted(Point, "_pdict_list", "_pos_dict")
    counted(ReferenceFrame, "_dict_list", "_dcm_dict")
    scene = da.Scene.from_urdf(robot)
    assert searches == []
    body = scene.bodies[-1]
    body.masscenter.pos_from(scene.origin)
    body.frame.dcm(scene.frame)
    assert len(searches) == 2
