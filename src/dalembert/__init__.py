"""dalembert: from a symbolic description of a constrained mechanical scene to a fast, accurate numerical simulator."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from . import errors, scenes
from .scene import Controller, CoulombFriction, Joint, Scene, UnilateralContact, free_orientation, table, unknowns
from .scene.shapes import Box, Cylinder, Disk, Ground, Path, Rod, Sphere, Spring
from .version import __version__

if TYPE_CHECKING:
    from .compiler import compile_model
    from .integrators.event_code import Event
    from .integrators.feedback import feedback
    from .integrators.samples import samples
    from .results.grid import grid
    from .results.sampler import normal, random_cases, sobol_cases, uniform
    from .runtime.reductions import final_value as final
    from .runtime.reductions import first_crossing, maximum, mean, minimum
    from .textbook import LagrangeView, Screw, lagrange

__all__ = [
    "Box",
    "Controller",
    "CoulombFriction",
    "Cylinder",
    "Disk",
    "Event",
    "Ground",
    "Joint",
    "LagrangeView",
    "Path",
    "Rod",
    "Scene",
    "Screw",
    "Sphere",
    "Spring",
    "UnilateralContact",
    "__version__",
    "compile_model",
    "errors",
    "feedback",
    "final",
    "first_crossing",
    "free_orientation",
    "grid",
    "lagrange",
    "maximum",
    "mean",
    "minimum",
    "normal",
    "random_cases",
    "samples",
    "scenes",
    "sobol_cases",
    "table",
    "uniform",
    "unknowns",
]

_ELSEWHERE = {
    "LagrangeView": ("textbook", "LagrangeView"),
    "Screw": ("textbook", "Screw"),
    "lagrange": ("textbook", "lagrange"),
    "compile_model": ("compiler", "compile_model"),
    "grid": ("results.grid", "grid"),
    "normal": ("results.sampler", "normal"),
    "random_cases": ("results.sampler", "random_cases"),
    "sobol_cases": ("results.sampler", "sobol_cases"),
    "uniform": ("results.sampler", "uniform"),
    "Event": ("integrators.event_code", "Event"),
    "final": ("runtime.reductions", "final_value"),
    "first_crossing": ("runtime.reductions", "first_crossing"),
    "maximum": ("runtime.reductions", "maximum"),
    "mean": ("runtime.reductions", "mean"),
    "minimum": ("runtime.reductions", "minimum"),
    "feedback": ("integrators.feedback", "feedback"),
    "samples": ("integrators.samples", "samples"),
}
"""Name -> module and name of objects that are imported on first use, because scenes are written without them."""


def __getattr__(name: str) -> Any:
    """Import an object on first use that scenes are written without."""
    if name not in _ELSEWHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, original = _ELSEWHERE[name]
    found = globals()[name] = getattr(import_module(f".{module}", __name__), original)
    return found


def __dir__() -> list[str]:
    """Return the public names, for completion."""
    return sorted(__all__)
