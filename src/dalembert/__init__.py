"""dalembert: from a symbolic description of a constrained mechanical scene to a fast, accurate simulator."""

from typing import TYPE_CHECKING, Any

from . import errors, scenes
from .compiler import compile_model
from .results.grid import grid
from .runtime.events import Event
from .runtime.reductions import final_value as final
from .runtime.reductions import first_crossing, maximum, mean, minimum
from .scene import CoulombFriction, Joint, Scene, UnilateralContact, free_orientation, unknowns

if TYPE_CHECKING:
    from .textbook import LagrangeView, Screw, lagrange

__version__ = "0.1.0"

__all__ = [
    "CoulombFriction",
    "Event",
    "Joint",
    "LagrangeView",
    "Scene",
    "Screw",
    "UnilateralContact",
    "__version__",
    "compile_model",
    "errors",
    "final",
    "first_crossing",
    "free_orientation",
    "grid",
    "lagrange",
    "maximum",
    "mean",
    "minimum",
    "scenes",
    "unknowns",
]

_TEXTBOOK = ("LagrangeView", "Screw", "lagrange")


def __getattr__(name: str) -> Any:
    """Import the textbook view when it is first asked for."""
    if name not in _TEXTBOOK:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import textbook

    return getattr(textbook, name)
