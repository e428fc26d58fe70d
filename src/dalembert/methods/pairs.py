"""The explicit Runge-Kutta pairs of the compiled loops, by the names that users write.

A new one takes a file with its tableau, and a line in `PAIRS`: every backend with compiled loops then has it.
"""

from __future__ import annotations

import pkgutil
from typing import TYPE_CHECKING, final

from ..frozen import frozen
from ..once import once_property

if TYPE_CHECKING:
    from .tableau import Tableau


@final
@frozen
class ExplicitPair:
    """An explicit pair.

    Attributes
    ----------
    description : str
        One line for `explain()`.
    place : str
        Module and name of its tableau. It is imported on first use, because checking its conditions takes time.
    """

    description: str
    place: str

    @once_property
    def tableau(self) -> Tableau:
        """The tableau."""
        found: Tableau = pkgutil.resolve_name(self.place)
        return found


PAIRS: dict[str, ExplicitPair] = {
    "dop853": ExplicitPair(
        "explicit Runge-Kutta of order 8 (Hairer, Norsett and Wanner)", "dalembert.methods.tableaus:DOP853"
    ),
    "tsit5": ExplicitPair("explicit Runge-Kutta of order 5 (Tsitouras)", "dalembert.methods.tableaus:TSIT5"),
}
"""All pairs by name."""
