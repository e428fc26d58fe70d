"""Tableaus of Runge-Kutta pairs; `dalembert.methods.names` names the explicit ones."""

from dataclasses import replace

import numpy as np

from dalembert.methods import tableau_data_dop853 as dop853
from dalembert.methods.tableau import Tableau, matrix_from_rows

from ..arrays import FloatArray
from ..once import once
from .names import PAIRS


def _dop853_dense() -> FloatArray:
    """Monomial form (16, 7) of DOP853's dense output.

    The published form is nested, ``x*(F0 + (1 - x)*(F1 + x*(F2 + (1 - x)*(F3 + ...))))``, with F0 the
    increment of the step, F1 = h*f0 - F0, F2 = 2*F0 - h*(f0 + f1) and F3 to F6 combinations of the stages.
    """
    b, first, last = np.zeros((3, 16))
    for j, weight in dop853.A[12].items():
        b[j] = weight
    first[0], last[12] = 1.0, 1.0
    published = [[dop853.D[k].get(j, 0.0) for j in range(16)] for k in range(4)]
    nested = np.array([b, first - b, 2.0 * b - first - last, *published])
    monomials = np.zeros((7, 7))
    basis = np.ones(1)
    for k in range(7):
        basis = np.convolve(basis, (0.0, 1.0) if k % 2 == 0 else (1.0, -1.0))
        monomials[k, : len(basis) - 1] = basis[1:]
    dense: FloatArray = nested.T @ monomials
    return dense


TSIT5 = Tableau(
    name="tsit5",
    order=5,
    error_order=4,
    dense_order=4,
    c=np.array([0.0, 0.161, 0.327, 0.9, 0.9800255409045097, 1.0, 1.0]),
    A=matrix_from_rows(
        7,
        {
            1: {0: 0.161},
            2: {0: -0.008480655492356989, 1: 0.335480655492357},
            3: {0: 2.8971530571054935, 1: -6.359448489975075, 2: 4.3622954328695815},
            4: {0: 5.325864828439257, 1: -11.748883564062828, 2: 7.4955393428898365, 3: -0.09249506636175525},
            5: {
                0: 5.86145544294642,
                1: -12.92096931784711,
                2: 8.159367898576159,
                3: -0.071584973281401,
                4: -0.028269050394068383,
            },
            6: {
                0: 0.09646076681806523,
                1: 0.01,
                2: 0.4798896504144996,
                3: 1.379008574103742,
                4: -3.290069515436081,
                5: 2.324710524099774,
            },
        },
    ),
    end=6,
    error=np.array(
        [
            [
                -0.00178001105222577714,
                -0.0008164344596567469,
                0.007880878010261995,
                -0.1447110071732629,
                0.5823571654525552,
                -0.45808210592918697,
                0.015151515151515152,
            ]
        ]
    ),
    error_orders=(4,),
    P=np.array(
        [
            [1.0, -2.763706197274826, 2.9132554618219126, -1.0530884977290216],
            [0.0, 0.13169999999999998, -0.2234, 0.1017],
            [0.0, 3.9302962368947516, -5.941033872131505, 2.490627285651253],
            [0.0, -12.411077166933676, 30.33818863028232, -16.548102889244902],
            [0.0, 37.50931341651104, -88.1789048947664, 47.37952196281928],
            [0.0, -27.896526289197286, 65.09189467479366, -34.87065786149661],
            [0.0, 1.5, -4.0, 2.5],
        ]
    ),
    source="Ch. Tsitouras, Runge-Kutta pairs of order 5(4) satisfying only the first column simplifying "
    "assumption, Computers & Mathematics with Applications 62 (2011) 770-775",
)

DOP853 = Tableau(
    name="dop853",
    order=8,
    error_order=7,
    dense_order=7,
    c=np.array(dop853.C),
    A=matrix_from_rows(16, dop853.A),
    end=12,
    error=np.array(
        [
            [dop853.E5.get(j, 0.0) for j in range(16)],
            [dop853.A[12].get(j, 0.0) - dop853.B3.get(j, 0.0) for j in range(16)],
        ]
    ),
    error_orders=(5, 3),
    P=_dop853_dense(),
    source="E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., 1993",
)


def _kvaerno5() -> Tableau:
    """Return Kvaerno's pair; its dense output is the cubic by the states and slopes at both ends."""
    A = matrix_from_rows(
        7,
        {
            1: {0: 0.26},
            2: {0: 0.13, 1: 0.84033320996790809},
            3: {0: 0.22371961478320505, 1: 0.47675532319799699, 2: -0.06470895363112615},
            4: {0: 0.16648564323248321, 1: 0.10450018841591720, 2: 0.03631482272098715, 3: -0.13090704451073998},
            5: {0: 0.13855640231268224, 2: -0.04245337201752043, 3: 0.02446657898003141, 4: 0.61943039072480676},
            6: {
                0: 0.13659751177640291,
                2: -0.05496908796538376,
                3: -0.04118626728321046,
                4: 0.62993304899016403,
                5: 0.06962479448202728,
            },
        },
    )
    A[1:, 1:] += 0.26 * np.eye(6)
    c, b, (first, last) = A.sum(axis=1), A[6], np.eye(7)[[0, 6]]
    c[5:] = 1.0
    return Tableau(
        name="kvaerno5",
        order=5,
        error_order=4,
        dense_order=3,
        c=c,
        A=A,
        end=6,
        error=_KVAERNO_ERROR * np.array([b - A[5]]),
        error_orders=(4,),
        P=np.array([first, 3.0 * b - 2.0 * first - last, first + last - 2.0 * b]).T,
        source="A. Kvaerno, BIT Numerical Mathematics 44 (2004) 489-502",
        implicit=True,
    )


_KVAERNO_ERROR = 10.0
"""Factor of the error estimate of Kvaerno's pair, which is too small: with the estimate itself the error of a forced
oscillator is 30 times the tolerances (that of explicit methods once or twice), though its stages are solved exactly."""

KVAERNO5 = _kvaerno5()

TABLEAUS = tuple(pair.tableau for pair in PAIRS.values())
"""The explicit pairs."""


@once
def bounded(tableau: Tableau) -> Tableau:
    """Return a pair whose steps also bound the error of the dense output, where the pair has an estimate of it.

    tsit5 needs none. Its stages allow one estimate of order 4, which is that of its steps, and where steps are stable
    that is at least a third of the error of its polynomials: `POLYNOMIAL_ERROR` is never reached.
    """
    if tableau.n_total == tableau.end + 1:
        return tableau
    return replace(tableau, name=f"{tableau.name}_bounded", bounded=True)
