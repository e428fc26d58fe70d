"""Digest of the sources and templates that generated code is made by, for the keys of disk caches."""

import hashlib
from functools import cache
from pathlib import Path

from .rendering import template_directory


def digest_of(folder: Path, pattern: str = "*.py") -> str:
    """SHA-256 over the names and the contents of every file under ``folder`` that fits, in sorted order."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob(pattern)):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(folder).as_posix()}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()


@cache
def generator_digest() -> str:
    """Digest of all sources that generated code depends on, this package included."""
    package = Path(__file__).parents[1]
    parts = ("ir", "methods", "transforms", "lowering", "codegen", "integrators")
    return digest_of(template_directory(), "*.j2") + "".join(digest_of(package / part) for part in parts)
