"""Runs of one block of the cases of a sweep: their results, reductions, events and checks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..codegen.engine import Engine
from ..codegen.runs import CaseRun
from ..lanes.cases import BlockResult
from ..lanes.sweep_arguments import KeptStarts
from ..methods.status import Status
from .case_settings import CaseSettings
from .cases import Cases

SMALLEST_BLOCK, LARGEST_BLOCK = 64, 4096


def slices_of(count: int, length: int) -> list[slice]:
    """Return so many cases in parts of some length."""
    if 0 < count <= length:
        return [slice(0, count)]
    return [slice(first, min(first + length, count)) for first in range(0, count, length)]


def run_one_block(
    engine: Engine, cases: Cases, settings: CaseSettings, block: slice, here: BlockResult, kept: KeptStarts
) -> None:
    """Run one block of cases and write their results and starts; cases that cannot start are left out.

    The totals of the results are the reductions.
    """
    run = columns_run(engine, cases, settings, block, here, len(here.y), kept)
    if run is not None:
        run.work()
        run.finish()
        return
    ready, status = cases.block(block, settings, exact=not engine.whole_blocks)
    if len(kept.states):
        kept.states[:], kept.constants[:] = ready.y, ready.c
    watch, good = settings.watch, status < 0
    if watch is None and not len(cases.program.layout.state):  # the constraints prescribe the motion
        here.ends[:] = np.column_stack([ready.spans[:, 1], np.where(good, float(Status.SUCCESS), status), 0.0 * status])
        return
    done = here
    if watch is not None:
        happened, totals = BlockResult.at_start(len(status), len(watch.events), watch.kinds)
        done = replace(here, happened=happened, totals=totals)
    if np.all(good):
        engine.integrate_block(ready, settings.method, done)
    else:
        done.y[~good] = np.nan
        done.ends[~good] = np.column_stack([ready.spans[~good, 0], status[~good], np.zeros(int(np.sum(~good)))])
    if np.any(good) and not np.all(good):
        rest = None if ready.inputs is None else ready.inputs.part(np.flatnonzero(good), len(good))
        carried = None if ready.carried is None else ready.carried[good]
        part = replace(ready, y=ready.y[good], c=ready.c[good], spans=ready.spans[good], inputs=rest, carried=carried)
        some = done[good]
        engine.integrate_block(part, settings.method, some)
        done[good] = some
        if ready.carried is not None:
            ready.carried[good] = carried
    if watch is not None:
        first = done.happened[:, 1::3]
        here.happened[:] = done.happened[:, : 3 * watch.reported]
        still = cases.program.conditions is None and cases.records is None
        c = ready.c if still else cases.constants_at(block, done.ends[:, :1])
        here.totals[:] = watch.reduced(ready.spans[:, 0], done.ends, done.y, c, done.totals, first)
        watch.conclude(done.ends, done.happened)


def check_results(cases: Cases, settings: CaseSettings, block: slice, here: BlockResult, kept: KeptStarts) -> None:
    """Check the results of a block of cases that kept their starts, where the settings have a check."""
    if settings.judge is None or not len(cases.program.layout.state):
        return
    if len(here.y) <= LARGEST_BLOCK:
        settings.judge(settings.method, cases.of_run(block, settings, kept), here)
        return
    for part in slices_of(block.stop - block.start, LARGEST_BLOCK):
        own = slice(block.start + part.start, block.start + part.stop)
        started = KeptStarts(kept.constants[part], kept.states[part])
        settings.judge(settings.method, cases.of_run(own, settings, started), here[part])


def columns_run(
    engine: Engine,
    cases: Cases,
    settings: CaseSettings,
    block: slice,
    here: BlockResult,
    share: int,
    kept: KeptStarts,
) -> CaseRun | None:
    """Return the run of a block of cases that the engine makes itself, None where that is not its way.

    The totals of the results are the reductions.
    """
    columns, watch, count = cases.columns(block, settings), settings.watch, len(here.y)
    if watch is None and (settings.t_eval is None or len(kept.constants) or not cases.program.projects):
        return engine.sweeper(columns, settings.method, here, kept, share)
    reduces = watch is not None and bool(watch.plan)
    if (reduces or watch is None) and not len(kept.constants):
        kept = kept._replace(constants=np.empty((count, cases.program.layout.constants)))
    done = here
    if watch is not None:
        happened, totals = BlockResult.at_start(count, len(watch.events), watch.kinds)
        done = BlockResult(here.y, here.ends, here.samples, happened, totals)
    run = engine.sweeper(columns, settings.method, done, kept, share)
    if run is None or watch is None:
        return run

    def finish() -> None:
        run.finish()
        here.happened[:] = done.happened[:, : 3 * watch.reported]
        if reduces:
            along = columns.constants_at
            c = kept.constants if along is None else along(done.ends[:, :1])
            first = done.happened[:, 1::3]
            here.totals[:] = watch.reduced(columns.spans[0], done.ends, done.y, c, done.totals, first)
        watch.conclude(done.ends, done.happened)

    return replace(run, finish=finish)
