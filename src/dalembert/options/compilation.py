"""Options of compilation."""

from __future__ import annotations

import math
from typing import Any, final

from ..errors import OptionError, unknown_name
from ..frozen import frozen

ORIENTATIONS = ("scene", "quaternion")
"""Coordinates that orient bodies: those of the scene, or unit quaternions in place of three angles."""

IMPACTS = ("newton", "poisson", "sequence")
"""Laws of impacts; their places are their numbers in compiled code (`dalembert.contacts.contact_system`)."""


@final
@frozen
class CompileOptions:
    """Options of a compilation; the arguments of `dalembert.compile_model`.

    Attributes
    ----------
    backend : str
        A name in `dalembert.codegen.BACKENDS`.
    formulation : str
        A name in `dalembert.reduction.FORMULATIONS`, or "auto".
    outputs : tuple
        Names or SymPy expressions to record.
    cache : bool
        Whether generated modules and compiled code may be kept on disk.
    gains : (float, float) or None
        Gains alpha and beta [1/s] of the formulation "baumgarte"; None leaves them to each run.
    orientation : str
        "scene" for the coordinates of the scene, "quaternion" to let unit quaternions take the place of angles.
    impacts : str
        "newton" and "poisson" for all contacts of an impact at once, "sequence" for one after the other.

    Raises
    ------
    OptionError
        For an orientation, or a law of impacts, that does not exist; for gains that are not two positive numbers, or
        that no formulation takes.
    """

    backend: str = "llvm"
    formulation: str = "auto"
    outputs: tuple[Any, ...] = ()
    cache: bool = True
    gains: tuple[float, float] | None = None
    orientation: str = "scene"
    impacts: str = "newton"

    def __post_init__(self) -> None:
        orientation: Any = self.orientation
        if not isinstance(orientation, str) or orientation not in ORIENTATIONS:
            raise OptionError(unknown_name("orientation", str(self.orientation), ORIENTATIONS))
        impacts: Any = self.impacts
        if not isinstance(impacts, str) or impacts not in IMPACTS:
            raise OptionError(unknown_name("law of impacts", str(self.impacts), IMPACTS))
        if self.gains is None:
            return
        try:
            alpha, beta = (float(gain) for gain in self.gains)
        except (TypeError, ValueError):
            raise OptionError(f"gains must be two numbers, alpha and beta [1/s], not {self.gains!r}") from None
        if not (0.0 <= alpha < math.inf and 0.0 <= beta < math.inf):
            raise OptionError(f"gains must be finite and not negative, not {self.gains!r}")
        if self.formulation != "baumgarte":
            raise OptionError(
                f"gains are those of the formulation 'baumgarte', not of {self.formulation!r}: give formulation="
                "'baumgarte' with them, or leave them out"
            )
        object.__setattr__(self, "gains", (alpha, beta))
