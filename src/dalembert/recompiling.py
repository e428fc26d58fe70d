"""Scenes that were compiled before, compiled again: in a mode of their contacts, or with more or less done a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .compiler import compile_scene
from .options import CompileOptions
from .reduction.modes import Mode
from .scene import Scene
from .stages import Stages

if TYPE_CHECKING:
    from .runtime.model import CompiledModel

__all__ = ["compile_mode", "recompile", "recompile_elapsed"]


def recompile(stages: Stages, without: tuple[int, ...] = (), kept: tuple[str, ...] | None = None) -> CompiledModel:
    """Return the model of the same scene with less, or more, done after each step.

    Parameters
    ----------
    stages : Stages
        Of the model.
    without : tuple of int
        Constraints that a run found to follow from the others; they are watched, but not enforced.
    kept : tuple of str, optional
        First integrals that are kept at their initial values; by default as before.

    Raises
    ------
    FormulationError
        Where the formulation cannot keep first integrals.
    """
    options = replace(stages.options, formulation=stages.program.formulation)
    return compile_mode(stages.scene, options, stages.mode, without, stages.kept if kept is None else kept)


def recompile_elapsed(stages: Stages, watched: Sequence[Any]) -> CompiledModel:
    """Return the model of the same scene in which time is counted from the start of each run.

    `watched` are expressions of events and reductions in which time itself occurs.
    """
    return compile_mode(stages.scene.in_elapsed_time(watched), stages.options, stages.mode, (), stages.kept)


def compile_mode(
    scene: Scene,
    options: CompileOptions,
    mode: Mode | None,
    without: tuple[int, ...] = (),
    kept: tuple[str, ...] = (),
) -> CompiledModel:
    """Return the model of a scene in one of the modes of its contacts; None for a scene that has only one."""
    from .runtime.hybrid import HybridModel

    model = compile_scene(scene, options, without, mode, kept)
    assert not isinstance(model, HybridModel)
    return model
