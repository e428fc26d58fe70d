"""Cases with contacts at an instant: `ContactCases`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..subset.arguments import IntMatrix, IntVector, Matrix, Vector
from ..subset.compiled_subset import compiled_subset
from .contact_laws import STATES

UNDECIDED = -1
"""Mode of a contact, and of a case, before the first decision, and `ContactCases.after` without an impact."""

ADDED, SIDE, REST = 4, 2, 3
"""Parameters that a contact adds to those of the scene, which begin with the direction of slip, and two of their places
(`dalembert.contacts.modes.mode_parameters`)."""

_STATES = len(STATES)


class ContactCases(NamedTuple):
    """Cases at an instant; of k cases with c contacts each.

    Attributes
    ----------
    t : (k,)
        Times [s].
    x : (k, 2 n_q + n_z)
        Coordinates, rates and first-order states; the rates change.
    p : (k, n_p)
        Parameters of the scene.
    added : (k, 4 c)
        Those that each contact adds: direction of slip (2); sign of the normal reaction, or of a contact that opens
        what is added to its guard; and slip speed in a plane below which it counts as at rest, negative in phases that
        do not begin at rest.
    speeds, approach : (k, c)
        Largest slip speed, and largest speed at which the gap closed, so far.
    flight : (k, c)
        How long each contact has been open [s].
    loads : (k, c)
        Largest size of the terms of each gap's acceleration so far.
    impacts, soon : (k,)
        Impacts at the instant so far; phases in a row that ended too soon.
    shared, shared_at : (k,)
        Impacts so far in which several contacts took part, or that followed others at the same instant; time of the
        first of them [s].
    span, passed : (k,)
        Duration of the whole motion, and of the last phase [s].
    modes, fired : (k, c)
        What each contact does, `UNDECIDED` before the start; guards that have fired, as bits.
    number : (k,)
        Number of the mode (`dalembert.contacts.automaton.HybridAutomaton.mode`), `UNDECIDED` before the start.
    after : (k, c)
        What is known of each contact after an impact, else `UNDECIDED`.
    status : (k,)
        SUCCESS where a mode was selected.
    motion : (k, n_q)
        Accelerations in the mode.
    """

    t: Vector
    x: Matrix
    p: Matrix
    added: Matrix
    speeds: Matrix
    approach: Matrix
    flight: Matrix
    loads: Matrix
    impacts: IntVector
    soon: IntVector
    shared: IntVector
    shared_at: Vector
    span: Vector
    passed: Vector
    modes: IntMatrix
    fired: IntMatrix
    number: IntVector
    after: IntMatrix
    status: IntVector
    motion: Matrix


def contact_cases(
    t: FloatArray, x: FloatArray, p: FloatArray, span: FloatArray, contacts: int, states: int = 0
) -> ContactCases:
    """Return cases before their first decision, in memory of their own.

    They start at times t (k,) from x (k, 2 n_q + n_z), with parameters p (k, n_p) and signed spans (k,). `states` is
    n_z, the number of first-order states.
    """
    t, x, p, span = (np.array(values, dtype=float, order="C") for values in (t, x, p, span))
    k, nothing = len(x), np.zeros((4, len(x), contacts))
    undecided = np.full((2, k, contacts), UNDECIDED)
    return ContactCases(
        t=t,
        x=x,
        p=p,
        added=np.tile([1.0, 0.0, 1.0, 1.0], (k, contacts)),
        speeds=nothing[0],
        approach=nothing[1],
        flight=nothing[2],
        loads=nothing[3],
        impacts=np.zeros(k, np.int64),
        soon=np.zeros(k, np.int64),
        shared=np.zeros(k, np.int64),
        shared_at=np.zeros(k),
        span=span,
        passed=np.zeros(k),
        modes=undecided[0],
        fired=np.zeros((k, contacts), np.int64),
        number=np.full(k, UNDECIDED),
        after=undecided[1],
        status=np.zeros(k, np.int64),
        motion=np.zeros((k, (x.shape[1] - states) // 2)),
    )


@compiled_subset
def set_mode(cases: ContactCases, case: int, mode: IntVector) -> None:
    """Write the mode of a case, the states of its contacts, and its number: these as digits, the first the lowest."""
    number, digit = 0, 1
    for i in range(mode.size):
        cases.modes[case, i] = mode[i]
        number += digit * mode[i]
        digit *= _STATES
    cases.number[case] = number
