"""dalembert: from a symbolic description of a constrained mechanical scene to a fast, accurate simulator."""

__version__ = "0.1.0"

from . import errors, scenes
from .compiler import compile_model
from .results.grid import grid
from .scene import Joint, Scene, unknowns

__all__ = ["Joint", "Scene", "__version__", "compile_model", "errors", "grid", "scenes", "unknowns"]
