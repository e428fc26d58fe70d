"""Cases of a sweep that cross configurations at which their constraints lose rank.

Where a formulation does not project, the branch beyond is a matter of chance. The Gram determinant of the constraints
of rows of length one touches zero there; its least value along the motion is a reduction that nobody asked for.
"""

from __future__ import annotations

import numpy as np

from ..codegen.base import BlockResult
from ..integrators.status import Status
from ..reduction.watching import INDEPENDENCE
from .reductions import Reduction
from .singular import CROSSED

__all__ = ["RANK", "lost_rank"]

RANK = {"least independence": Reduction("minimum", INDEPENDENCE)}
"""The last reduction of a sweep that is searched."""


def lost_rank(done: BlockResult) -> None:
    """Give cases whose constraints lost rank the status of a singular configuration."""
    least = done.totals[:, -1]
    status = done.ends[:, 1]
    lost = (least <= CROSSED**2) & np.isin(status, (Status.SUCCESS, Status.EVENT))
    status[lost] = float(Status.SINGULAR_CONFIGURATION)
