"""Two checkouts timed in alternation: what a change did to speed.

``python benchmarks/before_after.py OLD NEW`` takes two folders that hold `dalembert` (their ``src``), and prints one
table in Markdown: medians, minima, and the ratios new / old. Each checkout runs in a process of its own that answers
one request at a time, old and new in turn, so that a change of the machine's speed meets both alike. Scenes and
parameters are those of this script's own checkout. Each side uses the default backend, the first in its registry.

OLD twice instead of OLD and NEW shows how far ratios are from 1 by chance.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

TREES = ("old", "new")
CASES, THREADS = 16_384, 2
TOLERANCES = (1e-6, 1e-9, 1e-12)
SINGLE = ("sleigh", "sphere", "unequal sphere")

Task = Callable[[], Any]
Samples = dict[str, dict[str, list[float]]]
"""Seconds by name of the work and by tree."""


# -- what is timed, in a process of one checkout ------------------------------------------------


def _sweeps() -> Iterator[tuple[str, Task]]:
    from batches import BATCHES
    from cases import END
    from contenders import absolute

    import dalembert as da

    for name, build in BATCHES.items():
        batch = build(CASES)
        model = da.compile_model(batch.problem.build())
        initial, parameters = batch.initial, batch.parameters
        plans = [("taylor", rtol, {}) for rtol in TOLERANCES] + [("dop853", 1e-9, {})]
        if name == "sleigh":
            plans += [("taylor", 1e-9, {"events": ["theta"]})]
        for method, rtol, more in plans:
            options = {"method": method, "rtol": rtol, "atol": absolute(rtol), "threads": THREADS, **more}
            label = f"{name}, {method}{', an event' if more else ''}, rtol {rtol:g}"
            yield label, partial(model.sweep, (0.0, END), initial, parameters, **options)


def _single(called: bool) -> Iterator[tuple[str, Task]]:
    from cases import END, PROBLEMS
    from contenders import absolute

    import dalembert as da

    for name in SINGLE:
        problem = PROBLEMS[name]
        models = {kind: da.compile_model(problem.build(), formulation=kind) for kind in ("minimal", "projected")}
        plans = [("minimal", "taylor", rtol) for rtol in TOLERANCES]
        plans += [("minimal", "dop853", 1e-9), ("minimal", "radau", 1e-6), ("projected", "taylor", 1e-9)]
        for formulation, method, rtol in plans:
            model, label = models[formulation], f"{name}, {formulation} {method}, rtol {rtol:g}"
            options = {"method": method, "rtol": rtol, "atol": absolute(rtol)}
            if called:
                yield label, partial(model.simulate, (0.0, END), problem.initial, problem.parameters, **options)
            else:
                state = model.state(problem.initial, problem.parameters)
                run = model.prepare((0.0, END), **options)
                yield label, partial(run, state, model.parameter_vector(problem.parameters))


def _contacts() -> Iterator[tuple[str, Task]]:
    import contact_speed

    sweeps, runs = contact_speed.tasks(4096)
    for kind, tasks in (("sweep of 4,096", sweeps), ("simulate()", runs)):
        for name, task in tasks.items():
            yield f"{kind}, {name}", task


def _models() -> Iterator[tuple[str, Task]]:
    from cases import PROBLEMS
    from chains import planar_chain, spatial_chain
    from measure import forget

    import dalembert as da

    def compiled(build: Callable[[], Any]) -> None:
        forget()
        da.compile_model(build(), cache=False)

    builds: dict[str, Callable[[], Any]] = {name: PROBLEMS[name].build for name in SINGLE}
    builds["corner plate with friction"] = partial(da.scenes.corner_plate, friction=True)
    builds["planar chain of 8 links"] = partial(planar_chain, 8)
    builds["spatial chain of 8 links"] = partial(spatial_chain, 8)
    for name, build in builds.items():
        yield name, partial(compiled, build)


class Part(NamedTuple):
    """A kind of work: its title in the table, its tasks, how often each is repeated, and the unit of its times."""

    title: str
    tasks: Callable[[], Iterator[tuple[str, Task]]]
    share: float
    unit: str


PARTS = {
    "sweeps": Part(f"sweep of {CASES:,} cases on {THREADS} threads", _sweeps, 1.0, "ms"),
    "runs": Part("prepared run", partial(_single, False), 2.0, "us"),
    "calls": Part("simulate()", partial(_single, True), 1.0, "us"),
    "contacts": Part("contacts", _contacts, 0.5, "ms"),
    "compile": Part("compile_model without cache", _models, 0.3, "ms"),
}
STARTS = {"simulate": "first trajectory of the sleigh", "sweep": "first sweep of the sleigh"}
UNITS = {"us": 1e6, "ms": 1e3, "s": 1.0}


def serve(part: str) -> None:
    """Time tasks by name, one a line of standard input; begin with a line that lists them."""
    from measure import calls_of_sample, sample

    tasks = dict(PARTS[part].tasks())
    for task in tasks.values():
        task()  # compiles
    calls = {name: calls_of_sample(task)[0] for name, task in tasks.items()}
    _print(list(tasks))
    for line in sys.stdin:
        name = json.loads(line)
        _print(sample(tasks[name], calls[name]))


def _print(value: Any) -> None:
    print(json.dumps(value), flush=True)


# -- asking two processes in turn ---------------------------------------------------------------


class Server:
    """A process that times work in one checkout."""

    def __init__(self, part: str, environment: Mapping[str, str]) -> None:
        command = [sys.executable, __file__, "--serve", part]
        self._process = subprocess.Popen(
            command, env={**os.environ, **environment}, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.names: list[str] = self._answer()

    def seconds(self, name: str) -> float:
        """Return the seconds of one call, now."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(name) + "\n")
        self._process.stdin.flush()
        return float(self._answer())

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"the process of {self._process.args} ended with {self._process.wait()}")
        return json.loads(line)


def time_part(part: str, environments: Mapping[str, Mapping[str, str]], rounds: int, pairs: int) -> Samples:
    """Return samples of one kind of work; each of `pairs` pairs of processes gives its share of the rounds."""
    found: Samples = {}
    for pair in range(pairs):
        servers = {tree: Server(part, environments[tree]) for tree in TREES}
        for turn in range(-(-rounds // pairs)):
            for name in servers["old"].names:
                for tree in TREES if (turn + pair) % 2 else reversed(TREES):
                    found.setdefault(name, {tree: [] for tree in TREES})[tree].append(servers[tree].seconds(name))
        for server in servers.values():
            server.close()
    return found


def time_starts(environments: Mapping[str, Mapping[str, str]], folder: str, rounds: int) -> Samples:
    """Return samples of first and second processes, with empty caches before each first."""
    from startup import first_and_second, with_bytecode

    backends = {tree: _default_backend(environments[tree]) for tree in TREES}
    known = {tree: with_bytecode(backends[tree], f"{folder}/{tree}", environments[tree]) for tree in TREES}
    found: Samples = {}
    for turn in range(rounds):
        for what, title in STARTS.items():
            for tree in TREES if turn % 2 else reversed(TREES):
                records = first_and_second(backends[tree], what, f"{folder}/{tree}/{what}{turn}", known[tree])
                for process, seconds in records.items():
                    for stage in ("compile_model", "first call", "process"):
                        name = f"{title}, {process}, {'in all' if stage == 'process' else stage}"
                        found.setdefault(name, {tree: [] for tree in TREES})[tree].append(seconds[stage])
    return found


def _default_backend(environment: Mapping[str, str]) -> str:
    code = "from dalembert.codegen import BACKENDS; print(next(iter(BACKENDS)))"
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, env={**os.environ, **environment}, capture_output=True, text=True, check=True
    ).stdout.strip()


# -- the table ----------------------------------------------------------------------------------


def rows_of(title: str, samples: Samples, unit: str) -> Iterator[str]:
    """Yield a line of the table for each task."""
    for name, by_tree in samples.items():
        old, new = ([UNITS[unit] * value for value in by_tree[tree]] for tree in TREES)
        values = (statistics.median(old), statistics.median(new), min(old), min(new))
        times = " | ".join(f"{value:#.3g}".rstrip(".") for value in values)
        shares = f"{values[1] / values[0]:.2f} | {values[3] / values[2]:.2f}"
        yield f"| {title + ': ' if title else ''}{name} [{unit}] | {times} | {shares} |"


HEAD = "|  | old median | new median | old min | new min | ratio of medians | ratio of minima |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Time both checkouts, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", nargs="?", type=Path, help="the src folder of the checkout before the change")
    parser.add_argument("new", nargs="?", type=Path, help="the src folder of the checkout with the change")
    parser.add_argument("--parts", default=",".join([*PARTS, "starts"]), help="kinds of work (default: %(default)s)")
    parser.add_argument("--rounds", type=int, default=20, help="samples of a sweep and checkout (default: 20)")
    parser.add_argument("--pairs", type=int, default=2, help="pairs of processes of a part (default: 2)")
    parser.add_argument("--serve", choices=list(PARTS), help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.serve:
        serve(options.serve)
        return 0
    parts = options.parts.split(",")
    unknown = sorted(set(parts) - {*PARTS, "starts"})
    if unknown:
        parser.error(f"unknown parts: {', '.join(unknown)}; known are {', '.join([*PARTS, 'starts'])}")
    for path in (options.old, options.new):
        if path is None or not (path / "dalembert" / "__init__.py").exists():
            parser.error("OLD and NEW are folders that hold dalembert/__init__.py")
    print(HEAD + "\n| --- |" + " ---: |" * 6, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        environments = {
            tree: {"PYTHONPATH": str(path.resolve()), "DALEMBERT_CACHE_DIR": f"{folder}/{tree}/modules"}
            for tree, path in zip(TREES, (options.old, options.new), strict=True)
        }
        for name, part in PARTS.items():
            if name in parts:
                rounds = max(options.pairs, round(part.share * options.rounds))
                samples = time_part(name, environments, rounds, options.pairs)
                print("\n".join(rows_of(part.title, samples, part.unit)), flush=True)
        if "starts" in parts:
            samples = time_starts(environments, folder, max(1, round(0.3 * options.rounds)))
            print("\n".join(rows_of("", samples, "s")), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
