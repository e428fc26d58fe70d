"""Threads that use the package for the first time in a process, all at once.

``python tests/fuzz/cold_threads.py [--rounds 50] [--seed 0]``: every round is a new process with an empty cache. Its
eight threads wait for each other, and then make the same first sweep, or do everything that a model can do, each in an
order of its own, with one model or with models of their own. Whatever a thread finds must be what one thread alone
finds, to the bit. A process that ends with a signal, or does not end, is a failure.
"""

from __future__ import annotations

import argparse
import faulthandler
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable

import numpy as np

import dalembert as da
from dalembert.codegen.llvm.loops import library_folder

THREADS = 8
KINDS = ("sweep", "shared", "apart", "contacts", "numpy", "jax")
START = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
P = {"m": 1.0, "b": 0.3, "I_C": 0.5}
CASES = P | {"b": np.linspace(0.1, 0.5, 70)}
Q, QDOT = np.array([0.0, 0.0, 0.3]), np.array([0.9, 0.3, 1.7])
BELT = {"m": 1.0, "k": 4.0, "v_b": 0.7, "mu": 0.3, "mu_s": 0.5, "g": 9.81}
BLOCK = {"x": 0.0, "y": 0.0, "x_dot": 0.7, "y_dot": 0.0}

Action = Callable[[object], bytes]


def swept(model):
    return model.sweep((0, 1), START, CASES, threads=1)["x"].tobytes()


def simulated(model):
    return model.simulate((0, 1), START, P).q[-1].tobytes()


def watched(model):
    run = model.simulate((0, 1), START, P, events=["y"], t_eval=[0.0, 0.5, 1.0])
    return run.q.tobytes() + run.events["y"].t.tobytes()


def swept_with_events(model):
    sweep = model.sweep((0, 1), START, CASES, events=["y"], reduce={"top": da.maximum("y")}, threads=2)
    return sweep["x"].tobytes() + sweep.reduced["top"].tobytes()


def prepared(model):
    run = model.prepare((0, 1))
    return run(model.state(START, P), model.parameter_vector(P)).tobytes()


def varied(model):
    return model.sensitivity((0, 1), START, P, wrt=["b"], of=["x"]).jacobian("x", "b").tobytes()


def linearized(model):
    return model.linearize(0.0, START, P).A.tobytes()


def evaluated(model):
    return model.mass_matrix(Q, P).tobytes() + model.accelerations(0.0, Q, QDOT, P).tobytes()


def explained(model):
    return model.explain().split(" s")[0].encode()


def again(model):
    other = da.compile_model(model.stages.scene, formulation="projected", backend=model.backend)
    return other.simulate((0, 0.5), START, P).q[-1].tobytes()


def rubbed(model):
    sweep = model.sweep((0, 6), BLOCK, BELT | {"mu": np.linspace(0.2, 0.45, 12)}, threads=1)
    return sweep["x"].tobytes()


def rubbed_alone(model):
    run = model.simulate((0, 6), BLOCK, BELT)
    return run.q[-1].tobytes() + repr(run.phases).encode()


ACTIONS: dict[str, tuple[Action, ...]] = {
    "sweep": (swept,),
    "shared": (swept, simulated, watched, swept_with_events, prepared, varied, linearized, evaluated, explained, again),
    "contacts": (rubbed, rubbed_alone),
    "numpy": (swept, simulated, watched, prepared, varied, linearized, evaluated, explained, again),
    "jax": (swept, simulated, prepared, evaluated, explained, linearized),
}
ACTIONS["apart"] = ACTIONS["shared"]


def compiled(kind: str) -> object:
    scene = da.scenes.belt_oscillator() if kind == "contacts" else da.scenes.chaplygin_sleigh()
    return da.compile_model(scene, backend=kind if kind in ("numpy", "jax") else "llvm")


def child(kind: str, seed: int) -> None:
    """Let threads do everything at once, and compare what they find with what comes out afterwards, one by one."""
    faulthandler.enable()
    sys.setswitchinterval(1e-5)
    barrier, found = threading.Barrier(THREADS), [dict[str, bytes]() for _ in range(THREADS)]
    model = None if kind == "apart" else compiled(kind)

    def work(number: int) -> None:
        order = list(ACTIONS[kind])
        random.Random(seed * THREADS + number).shuffle(order)
        barrier.wait()
        own = compiled(kind) if model is None else model
        for action in order:
            found[number][action.__name__] = action(own)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    calm = compiled(kind)
    expected = {action.__name__: action(calm) for action in ACTIONS[kind]}
    for number, results in enumerate(found):
        different = [name for name, result in expected.items() if results.get(name) != result]
        assert not different, f"thread {number} of {kind!r}, seed {seed}: {different}"


def round_of(kind: str, seed: int, installed: bool = False) -> str:
    """Run one process with an empty cache; return what is wrong with it, nothing as a rule.

    With `installed`, the cache has the loops that are compiled once an installation, if they are here.
    """
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o700)
        command = [sys.executable, __file__, "--child", kind, "--seed", str(seed)]
        cache = os.path.join(folder, "cache")
        os.mkdir(cache, 0o700)
        if installed and (loops := library_folder()).exists():
            shutil.copytree(loops, os.path.join(cache, loops.name))
        environment = os.environ | {"DALEMBERT_CACHE_DIR": cache}
        try:
            run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
        except subprocess.TimeoutExpired:
            return f"{kind}, seed {seed}: does not end"
    return "" if run.returncode == 0 else f"{kind}, seed {seed}: exit status {run.returncode}\n{run.stderr[-2000:]}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS)
    parser.add_argument("--child", choices=KINDS)
    options = parser.parse_args()
    if options.child:
        child(options.child, options.seed)
        return 0
    wrong = 0
    for seed in range(options.seed, options.seed + options.rounds):
        trouble = round_of(options.kinds[seed % len(options.kinds)], seed)
        wrong += bool(trouble)
        if trouble:
            print(trouble, flush=True)
    print(f"{options.rounds} cold starts with {THREADS} threads, {wrong} wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
