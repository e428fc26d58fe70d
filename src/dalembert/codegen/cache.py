"""The content-addressed cache of generated modules, and the trust in its folders.

A module has a folder of its own, named by its digest, for the code that is compiled of it. Files appear by an atomic
rename, so that processes may share the cache. A file is used where nobody else can have written it
(`folder_refusal`) and its checksum, which covers the names of the file and its folder, is right; what is not
as it should be is rebuilt with a warning.
"""

from __future__ import annotations

import contextlib
import hashlib
import linecache
import os
import stat
import sys
import tempfile
import warnings
from functools import lru_cache
from pathlib import Path
from types import CodeType, ModuleType

from ..errors import CacheWarning, OptionError
from ..naming import Namer

# Trust in the files of a folder: nobody but the user and root can have written them.
#
# What the cache holds is loaded as machine code, so that whoever can write it can run code as the user. A folder is
# believed where it belongs to the user, and neither its group nor everybody can write it, and where the same holds of
# every folder above it, or these belong to root, or are sticky as ``/tmp`` is, where nobody can replace what belongs
# to others. Symbolic links are followed one by one, and must themselves lie in such folders and belong to the user or
# root. Where the platform has no owners of files (Windows) nothing is rejected: there, folders of the user are
# protected by access lists, which are not looked at. Nor are those that other platforms have besides.

_MOST_LINKS = 40
_OTHERS = stat.S_IWGRP | stat.S_IWOTH


def folder_refusal(folder: Path) -> str:
    """Return why what lies in a folder cannot be believed, nothing where it can; of one to be made, the folders above.

    Raises OSError where one cannot be looked at.
    """
    if not hasattr(os, "geteuid"):
        return ""
    path, links = Path.cwd() / folder, 0
    waiting = list(reversed(path.parts[1:]))
    here = Path(path.anchor)
    why = _refusal(here, os.lstat(here), last=False)
    while waiting and not why:
        name = waiting.pop()
        if name == "..":
            here = here.parent
            continue
        here /= name
        try:
            status = os.lstat(here)
        except FileNotFoundError:
            return ""
        if not stat.S_ISLNK(status.st_mode):
            why = _refusal(here, status, last=not waiting)
            continue
        links += 1
        if links > _MOST_LINKS:
            return f"{here} is a link that leads in a circle"
        if status.st_uid not in (0, os.geteuid()):
            return f"the link {here} belongs to another user (number {status.st_uid})"
        target = Path(os.readlink(here))
        waiting.extend(part for part in reversed(target.parts) if part != target.anchor)
        here = Path(target.anchor) if target.is_absolute() else here.parent
    return why


def _refusal(path: Path, status: os.stat_result, *, last: bool) -> str:
    """Return why a folder, or one above it, is rejected."""
    if not stat.S_ISDIR(status.st_mode):
        return f"{path} is not a folder"
    owners = (os.geteuid(),) if last else (0, os.geteuid())
    if status.st_uid not in owners:
        return f"{path} belongs to another user (number {status.st_uid})"
    if last or not status.st_mode & stat.S_ISVTX:
        return _writable(path, status)
    return ""


def _writable(path: Path, status: os.stat_result) -> str:
    """Return who else can write something, nothing where nobody else can."""
    if status.st_mode & stat.S_IWOTH:
        return f"everybody can write {path}"
    if status.st_mode & stat.S_IWGRP and not _alone_in(status.st_gid):
        return f"its group can write {path}"
    return ""


def _alone_in(group: int) -> bool:
    """Whether a group is that of an ordinary user alone, who is given such a group of the same name by many systems."""
    import grp
    import pwd

    try:
        user, found = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return user.pw_uid != 0 and user.pw_gid == group and found.gr_name == user.pw_name and not found.gr_mem


def descriptor_refusal(descriptor: int) -> str:
    """Return why an open file of a folder that is believed is not, nothing where it is."""
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        return "it is not a file"
    if not hasattr(os, "geteuid"):
        return ""
    if status.st_uid != os.geteuid():
        return f"it belongs to another user (number {status.st_uid})"
    return "others can write it" if status.st_mode & _OTHERS else ""


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it that are missing, for the user alone."""
    missing = []
    while not folder.exists():
        missing.append(folder)
        folder = folder.parent
    for path in reversed(missing):
        try:
            path.mkdir(mode=0o700)
        except FileExistsError:  # made by another process meanwhile
            if not path.is_dir():
                raise


ENVIRONMENT_VARIABLE = "DALEMBERT_CACHE_DIR"

_CHECK = hashlib.sha256().digest_size
_PLAINLY = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
"""No link is followed, no pipe is waited for, and no byte is changed."""


def directory() -> Path:
    """Return the folder of the cache: ``$DALEMBERT_CACHE_DIR``, or the user's cache folder of the platform."""
    chosen = os.environ.get(ENVIRONMENT_VARIABLE)
    if chosen:
        try:
            return Path(chosen).expanduser()
        except RuntimeError:
            raise OptionError(
                f"{ENVIRONMENT_VARIABLE} is {chosen!r}, and there is no such user; set it to a folder, or unset it"
            ) from None
    import platformdirs

    return platformdirs.user_cache_path("dalembert", appauthor=False)


def _write(path: Path, data: bytes) -> None:
    """Write a file by an atomic rename."""
    make_folder(path.parent)
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise


def refused(folder: Path) -> bool:
    """Return whether a folder of the cache is not trusted or not readable; warn with the reason."""
    try:
        why = folder_refusal(directory()) or folder_refusal(folder)
    except OSError as failure:
        why = str(failure)
    if why:
        text = f"the module cache {directory()} is not used, because {why}; nothing is loaded from it or kept."
        remedy = f"Set {ENVIRONMENT_VARIABLE} to a folder that nobody else can write, or take away others' rights"
        warnings.warn(f"{text} {remedy} (chmod go-w)", CacheWarning, stacklevel=3)
    return bool(why)


def read_kept(path: Path) -> bytes | None:
    """Return the content that `write_kept` wrote to a file; None where there is no file, or none that is trusted.

    A file that is damaged, that others could have written, or that was written under another name or to another folder,
    is removed with a warning.
    """
    if not os.path.exists(path.parent) or refused(path.parent):
        return None
    try:
        handle = os.open(path, os.O_RDONLY | _PLAINLY)
    except FileNotFoundError:
        return None
    except OSError as failure:
        why = f"cannot be read ({failure.strerror})"
    else:
        try:
            why = descriptor_refusal(handle)
            with open(handle, "rb", closefd=False) if not why else contextlib.nullcontext() as file:
                data = b"" if file is None else file.read()
        finally:
            os.close(handle)
        if not why and data[:_CHECK] == _checksum(path, data[_CHECK:]):
            return data[_CHECK:]
        why = f"is not believed ({why})" if why else "was damaged"
    warnings.warn(f"the cached code {path} {why} and is rebuilt", CacheWarning, stacklevel=3)
    with contextlib.suppress(OSError):
        os.unlink(path)
    return None


def write_kept(path: Path, data: bytes) -> None:
    """Write data to a file, with a checksum of the names of folder and file and of the data, if possible."""
    try:
        if not (folder_refusal(directory()) or folder_refusal(path.parent)):
            _write(path, _checksum(path, data) + data)
    except OSError:
        return


def _checksum(path: Path, data: bytes) -> bytes:
    """Return the checksum of the data of a file, which is valid for that name and folder alone."""
    return hashlib.sha256(b"\0".join((path.parent.name.encode(), path.name.encode(), data))).digest()


def module_folder(name: str, digest: str) -> Path | None:
    """Return the folder of a module; None, with a warning, if the cache cannot be used."""
    folder = directory() / f"{Namer()(name)[:40]}_{digest}"
    if refused(folder):
        return None
    try:
        make_folder(folder)
    except OSError as failure:
        _warn_unusable(failure)
        return None
    return folder


def _warn_unusable(failure: OSError) -> None:
    text = f"the module cache {directory()} cannot be used ({failure}); nothing is kept. Set {ENVIRONMENT_VARIABLE}"
    warnings.warn(f"{text} to a folder that can be written", CacheWarning, stacklevel=3)


def load_in_memory(digest: str, source: str, *, named: bool = False) -> ModuleType:
    """Return the module that holds `source` without touching the disk; tracebacks still show its lines.

    With `named` it can be imported by its name, which reading pickles of its functions needs.
    """
    filename = f"<dalembert generated {digest}>"
    module = ModuleType(f"dalembert_generated_{digest}")
    linecache.cache[filename] = (len(source), None, source.splitlines(keepends=True), filename)
    exec(_code_of(source, filename), module.__dict__)
    if named:
        sys.modules[module.__name__] = module
    return module


@lru_cache(maxsize=64)
def _code_of(source: str, filename: str) -> CodeType:
    """Return compiled source; models of one scene have the same."""
    return compile(source, filename, "exec")


def digest_of(*parts: str) -> str:
    """Return the digest that names a generated module."""
    return hashlib.sha256("\x1f".join(parts).encode()).hexdigest()[:24]
