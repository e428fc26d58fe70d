"""Long kernels that were lowered before, by this process or another: the cache on disk, read in place of lowering.

To lower the kernels of a robot takes longer than to derive its equations. A file is named after the digest of what its
kernel is made of, in a folder that is named after the sources of the package, and is trusted as other files of the
cache are (`dalembert.codegen.cache`).
"""

from __future__ import annotations

import hashlib
import marshal
import sys
import zlib
from collections.abc import Hashable
from pathlib import Path
from typing import final

from .. import naming
from ..ir.kernel import Assignment, Kernel, Load, Operand
from ..once import once
from ..transforms.lower_kernels import Lowered
from ..transforms.pipelines import PassRecord
from ..version import __version__
from .cache import digest_of, directory, read_kept, write_kept
from .rendering import generator_digest


@final
class KeptKernels:
    """The kernels on disk, a store of a graph; the text of a key is the same in every process."""

    def read(self, key: Hashable) -> Lowered | None:
        """See `KernelStore.read`."""
        data = read_kept(_path(key))
        return None if data is None else _unpacked(data)

    def keep(self, key: Hashable, lowered: Lowered) -> None:
        """See `KernelStore.keep`; a folder that cannot be used keeps nothing."""
        write_kept(_path(key), _packed(lowered))


def _path(key: Hashable) -> Path:
    return directory() / f"kernels_{_sources()}" / f"{hashlib.sha256(repr(key).encode()).hexdigest()}.kernel"


@once
def _sources() -> str:
    """Return the digest of the sources that lower kernels, and of what reads the files."""
    names = Path(naming.__file__).read_text(encoding="utf-8")
    return digest_of("kernels", __version__, sys.implementation.cache_tag or "", generator_digest(), names)


def _packed(lowered: Lowered) -> bytes:
    kernel, records = lowered
    parts = (
        (kernel.name, kernel.arguments, tuple(map(_plain, kernel.outputs))),
        [(load.target, load.array, load.index) for load in kernel.loads],
        [(line.target, line.op, *map(_plain, line.args)) for line in kernel.body],
        [(record.name, record.seconds, dict(record.before), dict(record.after)) for record in records],
    )
    return zlib.compress(marshal.dumps(parts), 1)


def _plain(operand: Operand) -> Operand:
    """Return an operand as one of Python's own types."""
    return operand if isinstance(operand, str) else float(operand)


def _unpacked(data: bytes) -> Lowered:
    (name, arguments, outputs), loads, body, records = marshal.loads(zlib.decompress(data))
    lines = tuple([Assignment(target, op, tuple(args)) for target, op, *args in body])
    kernel = Kernel(name, arguments, tuple([Load(*load) for load in loads]), lines, outputs)
    return kernel, [PassRecord(*record) for record in records]
