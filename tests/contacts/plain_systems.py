"""Systems of one contact as arrays written by hand: what the functions of contacts decide on, without a scene."""

import numpy as np

from dalembert.contacts.contact_cases import ContactCases, contact_cases
from dalembert.contacts.contact_system import SLIP, ContactSystem, Solved
from dalembert.contacts.selection.dense_solve import dense_workspace

__all__ = ["block", "one_case"]


def block(*, forcing=(0.0, 0.0), rates=(0.0, 0.0), gap=0.0, mass=None, power_of_friction=(1.0, 0.0), **numbers):
    """Return a body with coordinates x, y above a floor that it may touch, with friction along x.

    `numbers` are mu, mu_static and restitution; `mass` is the mass matrix, that of a point of one unit by default.
    """
    jacobian = np.array([[0.0, 1.0], [1.0, 0.0]])  # the gap y, and the slip velocity
    rates, solution = np.array(rates), np.zeros(5)
    whole = {name: np.array([numbers.get(name, 0.0)]) for name in ("mu", "mu_static", "restitution")}
    one = {"constraint": 0, "sense": 1, "normal": 0, "first": 0, "row": 1, "width": 1, "closed": SLIP, "tangential": 1}
    one |= dict.fromkeys(("leader", "sided", "soft", "given", "jumping", "column"), 0)
    topology = {name: np.array([number]) for name, number in one.items()}
    return ContactSystem(
        coordinates=2,
        constraints=1,
        contacts=1,
        slips=1,
        impacts=0,
        several=0,
        slides_by=np.array([[1, 0]]),
        loose=np.zeros(1, np.int64),
        row_owner=np.array([0, 0]),
        owner=np.array([0, -2]),
        angle=np.zeros(2, np.int64),
        values=np.zeros(0),
        mass=np.eye(2) if mass is None else np.array(mass, dtype=float),
        forcing=np.array(forcing, dtype=float),
        jacobian=jacobian,
        bias=np.zeros(2),
        velocity=jacobian @ rates,
        power=np.array([[0.0, 1.0], power_of_friction]),
        gap=np.array([gap]),
        regularization=np.zeros(1),
        normal_load=np.zeros(1),
        rates=rates,
        load=np.zeros(2),
        demand=np.zeros(2),
        restored=np.zeros(1),
        weight=np.ones(1),
        responses=np.zeros((8 * solution.size, 2)),
        kept=np.zeros(8, np.int64),
        scales=np.ones(5),
        saddle=np.zeros((3, 3)),
        saddle_right=np.zeros((3, 3)),
        compliances=np.zeros((2, 3)),
        square=np.zeros((3, 3)),
        square_right=np.zeros((3, 2)),
        laws=np.zeros((1, 1)),
        forces=np.zeros((1, 1)),
        held=np.zeros(1, np.int64),
        columns=np.zeros(2, np.int64),
        solution=solution,
        motion=solution[:2],
        press=solution[2:3],
        opening=solution[3:4],
        slip=solution[4:],
        free=np.zeros((1, 1)),
        solved=Solved(),
        dense=dense_workspace(3),
        **topology,
        **whole,
    )


def one_case(system: ContactSystem, x: float = 0.0) -> ContactCases:
    """Return a case before its first decision, at x, with the gap and the rates of a system."""
    state = np.array([[x, system.gap[0], *system.rates]])
    return contact_cases(np.zeros(1), state, np.zeros((1, 0)), np.ones(1), 1)
