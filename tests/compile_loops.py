"""Compile the loops of the package, which the processes of tests would else compile once each.

``python tests/compile_loops.py`` does so for the instruction set of the environment, in two processes. What lies in the
cache is not compiled again.
"""

from concurrent.futures import ProcessPoolExecutor

from dalembert.codegen.llvm.loops import SOURCES, loop_named
from dalembert.codegen.llvm.target import native_lanes


def compiled(name: str, lanes: int) -> bool:
    """Compile a loop for so many cases side by side; return whether there is machine code of it."""
    return bool(loop_named(name, lanes).call)


def main() -> None:
    """Compile all loops, that of lanes first, which takes longest."""
    loops = [("implicit_lane_loop", native_lanes()), *((name, 1) for name in SOURCES)]
    with ProcessPoolExecutor(2) as pool:
        assert all(pool.map(compiled, *zip(*loops, strict=True)))


if __name__ == "__main__":
    main()
