"""Programs in C for tests: compiled with warnings as errors, and run."""

import os
import shutil
import subprocess
from functools import cache

import pytest

from dalembert.codegen.llvm.target import ENVIRONMENT_VARIABLE, target

ARCHITECTURE = f"-march={os.environ.get(ENVIRONMENT_VARIABLE, 'native')}"
"""That for which machine code is made, so that programs in C have its bits."""

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror")


@cache
def compiler():
    """Return the C compiler."""
    found = shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")
    if found is None:
        pytest.skip("no C compiler")
    return found


@cache
def fuses():
    """Return whether the compiler fuses products and sums on this processor."""
    text = "#include <math.h>\n#if defined(FP_FAST_FMA) || defined(__FMA__)\nfused\n#endif\n"
    command = [compiler(), "-std=c99", ARCHITECTURE, "-E", "-P", "-x", "c", "-"]
    return "fused" in subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout


def same_bits():
    """Return whether programs in C have the bits of machine code, which needs products and sums that are fused."""
    return fuses() and target().fused


SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize=null,alignment", "-fsanitize-undefined-trap-on-error")
"""Options of programs that stop where they leave an array or do what C does not define.

They stop without a message, and nowhere tests of addresses are written for what stops a program by itself: no address
is that of another type, and nothing is at the address 0. Both take a third of the time of the compiler.
"""

OPTIMISED = ("-O2",)
"""Options of programs that are compiled as users do: some warnings are found where code is optimised."""


def built(folder, sources, *options):
    """Compile sources in a folder without warnings; return the program.

    Strict C99 has the same bits with and without optimisation, which takes twice as long; further options follow.
    """
    program = folder / "program"
    command = [compiler(), *WARNINGS, "-O0", ARCHITECTURE, *options, "-o", program, *sources, "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:3000]
    return program


def output(program, *arguments, status=0):
    """Run a program, and return what it prints; where it fails, what it prints of that."""
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == status, done.stderr[:3000]
    return done.stderr if status else done.stdout
