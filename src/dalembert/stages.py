"""What the pipeline passed from stage to stage, and how long each stage took."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

from .ir.program import Program
from .mechanics.equations import EquationsOfMotion
from .options import CompileOptions
from .reduction import ReducedSystem
from .reduction.modes import Mode
from .scene import Scene
from .scene.model import SceneModel

if TYPE_CHECKING:
    from .codegen.base import RenderedModule

__all__ = ["Stages", "Stopwatch"]


@final
@dataclass(frozen=True)
class Stages:
    """Every object that the pipeline passed from stage to stage, the seconds of each stage, and what was asked for."""

    scene: Scene
    model: SceneModel
    equations: EquationsOfMotion
    reduced: ReducedSystem
    program: Program
    rendered: RenderedModule
    seconds: dict[str, float]
    options: CompileOptions
    mode: Mode | None = None
    kept: tuple[str, ...] = ()


@final
class Stopwatch:
    """Runs stages and takes down how long each took."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: str, run: Any) -> Any:
        """Return what a stage gives."""
        start = time.perf_counter()
        result = run()
        self.seconds[stage] = time.perf_counter() - start
        return result
