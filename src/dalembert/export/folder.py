"""Folders and files of exports: nothing of others is overwritten; an export takes the place of an earlier one."""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import OptionError, list_names
from ..version import __version__

RECORD = ".dalembert-export.json"
"""File of an export that says what was written, by which an earlier export is known."""


def path_of(given: Any) -> Path:
    """Return where an export is to be written.

    Raises
    ------
    OptionError
        For what is no path, or lies in a folder that does not exist.
    """
    if not isinstance(given, str | os.PathLike) or not os.fspath(given):
        raise OptionError(f"path is {given!r}: give the folder that the export is written to")
    path = Path(os.fsdecode(given)).expanduser()
    if path.name in ("", ".."):
        raise OptionError(f"path is {str(given)!r}: give a new folder, such as {str(path / 'simulator')!r}")
    if not path.parent.is_dir():
        raise OptionError(f"the folder {str(path.parent)!r} of the path does not exist: make it first")
    return path


def refuse_others(path: Path) -> None:
    """Reject a path at which something is that no export has written.

    Raises
    ------
    OptionError
        With what is there.
    """
    if not path.exists() and not path.is_symlink():
        return
    if path.is_symlink() or not path.is_dir():
        raise OptionError(f"{str(path)!r} exists, and is no folder of an export: give another path, or remove it")
    found = sorted(item.name for item in path.iterdir())
    if not found:
        return
    try:
        written = json.loads((path / RECORD).read_text(encoding="utf-8"))["files"]
        changed = [name for name, digest in written.items() if _digest(path / name) not in (digest, "")]
        further = [
            name for name in found if name not in written and name != RECORD and not _built(path / name, written)
        ]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise OptionError(
            f"{str(path)!r} exists, and was not written by an export: nothing is overwritten. Give another path, or"
            f" remove it. It holds {list_names(found[:5])}{' and more' if len(found) > 5 else ''}"
        ) from None
    if changed or further:
        what = [f"{name} (changed since)" for name in changed] + further
        raise OptionError(
            f"{str(path)!r} is an earlier export, and holds what would be lost: {list_names(what)}. Give another path,"
            " or move these files away"
        )


def _digest(path: Path) -> str:
    """Return the digest of a file, nothing where it is gone."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else ""


def _built(path: Path, written: Mapping[str, str]) -> bool:
    """Return whether a file is what the Makefile of an export builds."""
    return path.is_file() and (path.suffix in (".o", ".so", ".a", ".exe") or f"{path.name}.c" in written)


def write_folder(path: Path, files: Mapping[str, str | bytes]) -> Path:
    """Write the files of an export to a folder, in the place of an earlier export; all of them or none.

    Raises
    ------
    OptionError
        Where something else is there.
    """
    refuse_others(path)
    made = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    try:
        contents = {name: text.encode() if isinstance(text, str) else text for name, text in files.items()}
        for name, content in contents.items():
            (made / name).write_bytes(content)
        digests = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
        record = {"written by": f"dalembert {__version__}", "files": digests}
        (made / RECORD).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        made.chmod(0o777 & ~_mask())
        if path.exists():
            shutil.rmtree(path)
        made.rename(path)
    except BaseException:
        shutil.rmtree(made, ignore_errors=True)
        raise
    return path


# Files: archives and pages.

_GENERATOR = '<meta name="generator" content="dalembert '
"""By which a page is known among its first lines."""

_WRITTEN = "# Written by dalembert "
"""Beginning of the first line of a file of Python."""


def refuse_other_files(path: Path) -> None:
    """Reject a path at which something is that is no archive, page or file of an export.

    Raises
    ------
    OptionError
    """
    if not path.exists() and not path.is_symlink():
        return
    try:
        if not path.is_symlink() and (_is_page_or_file(path) or _is_archive(path)):
            return
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
        pass
    raise OptionError(f"{str(path)!r} exists, and was not written by an export: give another path, or remove it")


def _is_page_or_file(path: Path) -> bool:
    with path.open("rb") as file:
        beginning = file.read(500)
    return _GENERATOR.encode() in beginning or beginning.startswith(_WRITTEN.encode())


def _is_archive(path: Path) -> bool:
    with zipfile.ZipFile(path) as archive:
        return str(json.loads(archive.read(f"resources/{RECORD}"))["written by"]).startswith("dalembert")


def write_archive(path: Path, files: Mapping[str, str | bytes]) -> Path:
    """Write an archive of files, in the place of an earlier one; all of it or nothing.

    Raises
    ------
    OptionError
        Where something else is there.
    """
    record = json.dumps({"written by": f"dalembert {__version__}"}) + "\n"
    return _write(path, zipped({**files, f"resources/{RECORD}": record}))


def zipped(files: Mapping[str, str | bytes]) -> bytes:
    """Return an archive of files; the same files give the same archive."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, content)
    return made.getvalue()


def write_file(path: Path, text: str) -> Path:
    """Write a page or a file of Python, in the place of an earlier one; all of it or nothing.

    Raises
    ------
    OptionError
        Where something else is there.
    """
    return _write(path, text.encode())


def _write(path: Path, content: bytes) -> Path:
    refuse_other_files(path)
    descriptor, made = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        os.chmod(made, 0o666 & ~_mask())
        os.replace(made, path)
    except BaseException:
        Path(made).unlink(missing_ok=True)
        raise
    return path


def _mask() -> int:
    """Return the permissions that new folders do not get."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
