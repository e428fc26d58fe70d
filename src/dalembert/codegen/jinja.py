"""Jinja's environment for the templates of generated code; it alone imports Jinja."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, final

import jinja2
from jinja2.bccache import Bucket

from .cache import digest_of, directory, read_kept, write_kept

_OPTIONS: dict[str, Any] = {
    "undefined": jinja2.StrictUndefined,
    "trim_blocks": True,
    "lstrip_blocks": True,
    "keep_trailing_newline": True,
    "autoescape": False,
    "optimized": False,
    "auto_reload": False,
}


def environment(folder: Path) -> jinja2.Environment:
    """Return the environment of the templates in a folder."""
    return jinja2.Environment(loader=jinja2.FileSystemLoader(folder), bytecode_cache=_CompiledTemplates(), **_OPTIONS)


@final
class _CompiledTemplates(jinja2.BytecodeCache):
    """Templates of LLVM assembly as bytecode in the cache on disk: compiling them takes longer than rendering.

    Like the library's own loops they belong to the installation, not to a scene.
    """

    def get_cache_key(self, name: str, filename: str | None = None) -> str:
        """Return the key of a template: its name."""
        return name

    def load_bytecode(self, bucket: Bucket) -> None:
        """Read the bytecode of a template, where it is there."""
        data = read_kept(_path(bucket)) if _is_kept(bucket) else None
        if data is not None:
            bucket.bytecode_from_string(data)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep the bytecode of a template."""
        if _is_kept(bucket):
            write_kept(_path(bucket), bucket.bytecode_to_string())


def _is_kept(bucket: Bucket) -> bool:
    return bucket.key.startswith("llvm/")


def _path(bucket: Bucket) -> Path:
    # the checksum is that of the template's text
    digest = digest_of("template", jinja2.__version__, sys.version, repr(_OPTIONS), bucket.key, bucket.checksum)
    return directory() / "templates" / f"{digest}.bytecode"
