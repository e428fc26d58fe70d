"""Outcomes of the chunks of a stored sweep."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeAlias

__all__ = ["LostCluster", "Outcomes"]

Outcomes: TypeAlias = Generator[tuple[int, BaseException | None], None, None]
"""The number of each chunk that was tried, and what stopped it."""


class LostCluster(Exception):
    """The scheduler does not answer any more."""
