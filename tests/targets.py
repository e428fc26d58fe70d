"""Run tests for other instruction sets: ``python tests/targets.py all``, and arguments of pytest.

``all`` are all targets of this processor, by two processes; ``least`` is the first one, where its lanes are fewer than
those of the processor, and ``between`` are the others that have fewer, by one process, which compiles only the loops
that its tests need. NumPy and OpenBLAS, which read that when they are loaded, are limited to the same instructions.
"""

import os
import subprocess
import sys

import numpy as np

from dalembert.codegen.llvm.target import ENVIRONMENT_VARIABLE, available_targets

LACKING = {"x86-64-v2": ("AVX", "F16C", "FMA", "X86_V3", "X86_V4"), "x86-64-v3": ("AVX512", "X86_V4")}
"""How the names of NumPy's features begin that a target lacks."""

KERNELS = {"x86-64-v2": "Nehalem", "x86-64-v3": "Haswell"}
"""Kernels of OpenBLAS by target."""


def environment(name: str) -> dict[str, str]:
    """Return the variables that limit a process to a target."""
    wanted = {ENVIRONMENT_VARIABLE: name}
    if name in KERNELS:
        found = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
        wanted["NPY_DISABLE_CPU_FEATURES"] = " ".join(feature for feature in found if feature.startswith(LACKING[name]))
        wanted["OPENBLAS_CORETYPE"] = KERNELS[name]
    return wanted


def main(which: str, *arguments: str) -> int:
    """Run pytest for each target until one fails."""
    known = available_targets()
    fewer = [name for name, target in known.items() if target.lanes < known["native"].lanes]
    for name in {"all": list(known), "least": fewer[:1], "between": fewer[1:]}[which]:
        print(f"==> pytest: what the processor decides, for {name} ({known[name].lanes} lanes)", flush=True)
        commands = [["-m", "pytest", "-q", "-n", "0", *arguments]]
        if which == "all":
            commands = [["tests/compile_once.py"], ["-m", "pytest", "-q", "-n", "2", *arguments]]
        for command in commands:
            if status := subprocess.run([sys.executable, *command], env=os.environ | environment(name)).returncode:
                return status
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
