"""Models as bytes from which another process makes them without deriving anything.

``pickle.dumps(model)`` has the scene, which is small and is derived again where it is read. Here a model has its
program and the equations of motion that it was made of, so that every process runs the very same program.
"""

from __future__ import annotations

import copyreg
import io
import pickle
from typing import TYPE_CHECKING, Any

from ...codegen import backend_named
from ...codegen.base import RenderedModule
from ...ir.program import Program
from ...once import DERIVING
from ...pipeline import Compiled, SeveralModes, Stages
from .swept_models import SweptModel

if TYPE_CHECKING:
    from ..model import CompiledModel

__all__ = ["packed", "unpacked"]


def packed(model: SweptModel) -> bytes:
    """Return a model as bytes."""
    kind: type[Any] = type(model.model)
    reductions: dict[type, Any] = {
        kind: lambda each: (_loaded, (kind, each.modes.several) if each.modes else (kind, each.stages, each.dropped)),
        RenderedModule: lambda each: (_rendered, (each.backend, each.program)),
    }
    data = io.BytesIO()
    pickler = pickle.Pickler(data, protocol=5)
    pickler.dispatch_table = copyreg.dispatch_table | reductions
    with DERIVING:  # graphs do not change meanwhile
        pickler.dump(model)
    return data.getvalue()


def unpacked(data: bytes) -> SweptModel:
    """Return the model that a process of the same versions packed."""
    model: SweptModel = pickle.loads(data)
    return model


def _rendered(backend: str, program: Program) -> RenderedModule:
    return backend_named(backend).render(program)


def _loaded(kind: type[CompiledModel], stages: Stages | SeveralModes, dropped: tuple[int, ...] = ()) -> CompiledModel:
    """Return the model of stages, its code compiled, or read from the cache, in this process."""
    if isinstance(stages, SeveralModes):
        return kind.of(stages)
    backend = backend_named(stages.rendered.backend)
    engine = backend.load(stages.rendered, cache=stages.options.cache)
    return kind.of(Compiled(stages, engine, backend.serving(stages.program)), dropped)
