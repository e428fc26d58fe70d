"""Results of `trim`, and their messages where conditions are not met."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, final

import numpy as np

from ..arrays import FloatArray
from ..errors import OptionError, ValueInputError, list_names
from ..frozen import frozen
from ..ir.program import Layout
from ..results.analyses import OperatingPoint
from ..starts.input_values import input_places
from ..starts.symbol_assumptions import ROUNDING, refuse_contradictions
from .newton import Root
from .steady_conditions import SteadyConditions

if TYPE_CHECKING:
    from ..model.model import CompiledModel

_RANK = 1e-9
_SHOWN = 1e-3
"""Share of the largest component of a direction from which on a value belongs to it."""

_MOST_SHOWN = 6


def given_places(layout: Layout) -> dict[str, int]:
    """Return where among the parameters those of the user and the values of the inputs stand, by name."""
    places = {name: i for i, name in enumerate(layout.parameters) if name in layout.given}
    return places | dict(zip(layout.inputs, input_places(layout), strict=True))


@final
@frozen
class TrimChoice:
    """Names of the free values, of those that follow from the constraints, and whether `steady` was left out."""

    free: tuple[str, ...]
    follow: tuple[str, ...]
    default: bool


@final
@frozen(eq=False)
class TrimReport:
    """Report of the iteration: message, and values by name."""

    model: CompiledModel
    conditions: SteadyConditions
    root: Root
    chosen: TrimChoice
    share: FloatArray

    def point(self) -> OperatingPoint:
        """Return the result.

        Raises
        ------
        OptionError
            Where more conditions than free values could not be met.
        """
        layout, root = self.model.layout, self.root
        x, p = self.conditions.values(root.unknowns)
        names = layout.variables
        c = self.conditions.constants(p)
        changes = self.conditions.changes(x, c)
        initial = dict(zip(names, x.tolist(), strict=True))
        given = {name: float(p[i]) for name, i in given_places(layout).items()}
        fault = self._fault(x, c, initial, given)
        return OperatingPoint(
            t=self.conditions.t,
            converged=not fault,
            message=fault or self._success(),
            iterations=root.iterations,
            free=self.chosen.free,
            initial=initial,
            parameters={name: given[name] for name in layout.given},
            inputs={name: given[name] for name in layout.inputs},
            residual=dict(zip(self.conditions.labels, root.residual.tolist(), strict=True)),
            derivatives=dict(zip(names, changes.tolist(), strict=True)),
            undetermined=self._undetermined(),
            aliases=layout.aliases,
        )

    def _success(self) -> str:
        found = f"all {len(self.root.residual)} conditions hold after {self.root.iterations} iterations"
        lost = self._undetermined()
        if not lost:
            return found
        return (
            f"{found}; they do not determine {list_names(lost)}, so that each iteration took the least change of the"
            " free values"
        )

    def _undetermined(self) -> tuple[str, ...]:
        directions = self.root.free
        if not directions.size:
            return ()
        share = np.linalg.norm(directions, axis=1)
        return tuple(name for name, part in zip(self._unknowns(), share, strict=True) if part > _SHOWN)

    def _unknowns(self) -> list[str]:
        layout = self.model.layout
        names = layout.variables
        places = self.conditions
        given = {i: name for name, i in given_places(layout).items()}
        return [names[i] for i in places.free_x] + [given[i] for i in places.free_p]

    def _fault(self, x: FloatArray, c: FloatArray, initial: Mapping[str, float], given: Mapping[str, float]) -> str:
        """Return why the result is no equilibrium or steady motion; nothing where it is."""
        layout = self.model.layout
        if not np.all(self.share <= 1.0):
            return self._left(x, c)
        try:
            refuse_contradictions(layout.assumptions, initial, ROUNDING)
            refuse_contradictions(layout.assumptions, given)
        except ValueInputError as reason:
            return f"all conditions hold, but {reason}"
        if self.chosen.default:
            every, covered = self.conditions.accelerations_left(x, c, self.conditions.steady)
            if covered < every:
                moving = self._accelerating(x, c)
                return (
                    "the conditions hold, but do not determine every acceleration there"
                    f" ({list_names(moving) or 'the others'} may change): give all rates in the guess, or name in"
                    " steady what must not change"
                )
        return ""

    def _accelerating(self, x: FloatArray, c: FloatArray) -> list[str]:
        second = self.conditions.partials.value("accelerations", self.conditions.t, x, c)
        shares = np.abs(second) / self.conditions.sizes()
        limit = _RANK * float(np.max(shares, initial=0.0))
        return [name for name, share in zip(self.model.layout.rates, shares, strict=True) if share > limit]

    def _left(self, x: FloatArray, c: FloatArray) -> str:
        """Return which conditions could not be met, and what to do.

        Raises
        ------
        OptionError
            Where there are more conditions than free values.
        """
        root = self.root
        worst = [i for i in np.argsort(-self.share) if not self.share[i] <= 1.0][:_MOST_SHOWN]
        left = ", ".join(f"{self.conditions.labels[i]} = {root.residual[i]:.3g}" for i in worst)
        at = ", ".join(f"{name} = {v:.6g}" for name, v in zip(self._unknowns(), root.unknowns, strict=True))
        count, unknowns = self._count(x, c), len(root.unknowns)
        if count > unknowns:
            raise OptionError(
                f"{count} conditions are to be met by {unknowns} free values"
                f" ({list_names(self._unknowns())}), and are not: {left} is left at best, at {at}. Let more be free"
                " (free=[...]), or name in steady only what must not change; a steady motion may leave out the"
                " coordinates that follow from velocity constraints"
            )
        return (
            f"not all conditions could be met: {left} is left after {root.iterations} iterations, at {at}. There may be"
            " no equilibrium or steady motion with the values that are held; otherwise start nearer to it, or let other"
            " values be free"
        )

    def _count(self, x: FloatArray, c: FloatArray) -> int:
        """Return the number of conditions that say something and do not follow from others."""
        root, groups = self.root, self.conditions.groups
        unmet = ~(self.share <= 1.0)
        rows = np.abs(root.jacobian) @ root.size / root.scale
        tells = (rows > _RANK) | unmet
        count = int(np.count_nonzero(tells & ((groups == 2) | (groups == 4))))
        for group in (0, 1):
            own = (root.jacobian * root.size)[groups == group] / root.scale[groups == group, np.newaxis]
            rank = int(np.linalg.matrix_rank(own, tol=_RANK)) if own.size else 0
            count += max(rank, int(np.any(unmet[groups == group])))
        steady = self.conditions.steady
        _, independent = self.conditions.accelerations_left(x, c, steady)
        return count + min(independent, int(np.count_nonzero(tells & (groups == 3))))
