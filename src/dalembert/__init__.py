"""dalembert: from a symbolic description of a constrained mechanical scene to a fast, accurate numerical simulator."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from . import errors, scenes
from .scene import (
    BoxPlane,
    Closure,
    Controller,
    CoulombFriction,
    DiscPlane,
    Gear,
    Joint,
    PointPlane,
    RollingDisc,
    RollingSphere,
    Rope,
    Scene,
    SphereInBowl,
    SphereInCylinder,
    SpherePlane,
    SphereSphere,
    Stop,
    UnilateralContact,
    compiled,
    free_orientation,
    table,
    unknowns,
)
from .scene.shapes import Box, Cylinder, Disk, Ground, Mesh, Path, Rod, Sphere, Spring
from .version import __version__

if TYPE_CHECKING:
    from .analysis.base_parameters import base_parameters
    from .analysis.body_inertias import body_inertias, identify_bodies
    from .analysis.excitation import design_excitation
    from .analysis.identification import identify
    from .compiler import compile_model
    from .events.event_code import Event
    from .results.cases import grid, normal, random_cases, sobol_cases, uniform
    from .runs.reductions import final_value as final
    from .runs.reductions import first_crossing, maximum, mean, minimum
    from .stops.feedback import feedback
    from .stops.samples import samples
    from .textbook import LagrangeView, Screw, lagrange

__all__ = [
    "Box",
    "BoxPlane",
    "Closure",
    "Controller",
    "CoulombFriction",
    "Cylinder",
    "DiscPlane",
    "Disk",
    "Event",
    "Gear",
    "Ground",
    "Joint",
    "LagrangeView",
    "Mesh",
    "Path",
    "PointPlane",
    "Rod",
    "RollingDisc",
    "RollingSphere",
    "Rope",
    "Scene",
    "Screw",
    "Sphere",
    "SphereInBowl",
    "SphereInCylinder",
    "SpherePlane",
    "SphereSphere",
    "Spring",
    "Stop",
    "UnilateralContact",
    "__version__",
    "base_parameters",
    "body_inertias",
    "compile_model",
    "compiled",
    "design_excitation",
    "errors",
    "feedback",
    "final",
    "first_crossing",
    "free_orientation",
    "grid",
    "identify",
    "identify_bodies",
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
    "base_parameters": ("analysis.base_parameters", "base_parameters"),
    "body_inertias": ("analysis.body_inertias", "body_inertias"),
    "design_excitation": ("analysis.excitation", "design_excitation"),
    "identify": ("analysis.identification", "identify"),
    "identify_bodies": ("analysis.body_inertias", "identify_bodies"),
    "LagrangeView": ("textbook", "LagrangeView"),
    "Screw": ("textbook", "Screw"),
    "lagrange": ("textbook", "lagrange"),
    "compile_model": ("compiler", "compile_model"),
    "grid": ("results.cases", "grid"),
    "normal": ("results.cases", "normal"),
    "random_cases": ("results.cases", "random_cases"),
    "sobol_cases": ("results.cases", "sobol_cases"),
    "uniform": ("results.cases", "uniform"),
    "Event": ("events.event_code", "Event"),
    "final": ("runs.reductions", "final_value"),
    "first_crossing": ("runs.reductions", "first_crossing"),
    "maximum": ("runs.reductions", "maximum"),
    "mean": ("runs.reductions", "mean"),
    "minimum": ("runs.reductions", "minimum"),
    "feedback": ("stops.feedback", "feedback"),
    "samples": ("stops.samples", "samples"),
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
