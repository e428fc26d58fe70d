"""Compile what the processes of tests would else compile once each, in two processes.

``python tests/compile_once.py`` compiles the loops of the package for the instruction set of the environment. What lies
in the cache is not compiled again. With arguments of pytest it also collects the tests that they choose, so that there
is bytecode of these and of all that they import.
"""

import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor

from dalembert.codegen.llvm.loops import SOURCES, loop_named
from dalembert.codegen.llvm.target import native_lanes


def compiled(name: str, lanes: int) -> bool:
    """Compile a loop for so many cases side by side; return whether there is machine code of it, without numba."""
    return bool(loop_named(name, lanes).call) and "numba" not in sys.modules


def faults(chosen: tuple[str, ...]) -> str:
    """Collect tests; return what pytest says where that fails."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-qq", "-n", "0", *chosen]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    return done.stdout if done.returncode else ""


def main(*chosen: str) -> str:
    """Collect the tests chosen and compile all loops, that of lanes first, which takes longest; return faults."""
    loops = [("implicit_lane_loop", native_lanes()), *((name, 1) for name in SOURCES)]
    with ProcessPoolExecutor(2) as pool:
        collecting = pool.submit(faults, chosen) if chosen else None
        assert all(pool.map(compiled, *zip(*loops, strict=True)))
        return collecting.result() if collecting else ""


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]) or None)
