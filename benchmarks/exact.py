"""The exact solutions of `tests/oracles`, for benchmarks: one copy serves both.

`tests/` is not a package that is installed; this module alone puts it on the path.
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from oracles.cases import SLEIGH_CASES, SPHERE_CASES, Case  # noqa: E402
from oracles.sphere_exact import spatial_angular_velocity  # noqa: E402

__all__ = ["END", "ROOT", "SLEIGH", "SPHERE", "Case", "final_error", "spatial_angular_velocity"]

SLEIGH: Case = SLEIGH_CASES[0]
SPHERE: Case = SPHERE_CASES[0]
END = 10.0
"""End of every motion that is timed [s]."""


def final_error(case: Case, q: NDArray[np.float64], qdot: NDArray[np.float64]) -> float:
    """Return the largest error of coordinates and rates at `END`, from q and q_dot (n_q,) there."""
    exact = case.exact(END)
    return float(max(abs(q - exact.q).max(), abs(qdot - exact.qdot).max()))
