"""Trust in the files of a folder: nobody but the user and root can have written them.

What the cache holds is loaded as machine code, so that whoever can write it can run code as the user. A folder is
believed where it belongs to the user, and neither its group nor everybody can write it, and where the same holds of
every folder above it, or these belong to root, or are sticky as ``/tmp`` is, where nobody can replace what belongs to
others. Symbolic links are followed one by one, and must themselves lie in such folders and belong to the user or root.
Where the platform has no owners of files (Windows) nothing is refused: there, folders of the user are protected by
access lists, which are not looked at. Nor are those that other platforms have besides.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

__all__ = ["descriptor_refusal", "folder_refusal", "make_folder"]

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
    """Return why a folder, or one above it, is refused."""
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
