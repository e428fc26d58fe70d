"""How contacts stand before it is decided what they do: open, touching, gripped or sliding, in many cases at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...integrators.mode_selection import NOISE
from ...mechanics.equations import ContactRow, Watchpoint
from ...reduction.modes import OPEN, STICK, Mode
from .deciding import FREE, GRIPPED, LIFTING, SLIDING, TOUCHING, Standing
from .facts import Facts
from .instants import Instants

__all__ = ["Standings", "length"]

STOPPED = 1e-5
"""Share of the slip velocities of a run below which one along two directions has come to rest."""

_LENGTH = 1.0001
"""What gaps are compared with beside their own size."""

_STILL = 1e-12
"""Share of the largest rate that a gap could have with the kinetic energy there is, up to which it has none."""


@final
class Standings:
    """Tells how the contacts of a scene stand."""

    def __init__(self, contacts: Sequence[ContactRow]) -> None:
        self.contacts = tuple(contacts)

    def coded(
        self,
        facts: Facts | None,
        slips: FloatArray,
        now: Instants,
        mode: Mode | None,
        fired: Sequence[Watchpoint],
        speeds: FloatArray,
    ) -> tuple[dict[int, list[Standing]], NDArray[np.intp]]:
        """Return a number for each case, and what it says of how its contacts stand."""
        k, table = len(self.contacts), list[Standing]()
        alike = None if facts is not None else self._alike(mode, fired)
        if alike is not None:
            return {0: alike}, np.zeros(len(now.t), np.intp)
        codes = np.array([self._standings(facts, slips, i, mode, fired, speeds, table) for i in range(k)]).T
        mixed = codes.reshape(len(now.t), k) @ (len(table) ** np.arange(k))
        _, firsts = np.unique(mixed, return_index=True)
        return {int(mixed[i]): [table[code] for code in codes[i]] for i in firsts}, mixed

    def _alike(self, mode: Mode | None, fired: Sequence[Watchpoint]) -> list[Standing] | None:
        """Return how contacts stand where that is the same in all cases, whatever their slips; else None."""
        found = []
        for i, contact in enumerate(self.contacts):
            kinds = {point.kind for point in fired if point.contact == i}
            before = None if mode is None else mode[i]
            broken = [point.sign for point in fired if point.contact == i and point.kind == "break"]
            if len(contact.tangential) != 1 or contact.regularization is not None or kinds & {"lift", "meet"}:
                return None
            if before == OPEN or not (broken or before == STICK or "stop" in kinds):
                return None
            found.append(Standing(GRIPPED, broken=broken[0] if broken else None, turned="turn" in kinds))
        return found

    def _standings(
        self,
        facts: Facts | None,
        slips: FloatArray,
        i: int,
        mode: Mode | None,
        fired: Sequence[Watchpoint],
        speeds: FloatArray,
        table: list[Standing],
    ) -> NDArray[np.intp]:
        """Return how a contact stands in each case (k,), as numbers in `table`, which grows.

        The facts are needed where nothing is known before, and where a gap closes.
        """
        contact, count = self.contacts[i], len(slips)
        mine = [point for point in fired if point.contact == i]
        kinds = {point.kind for point in mine}
        before = None if mode is None else mode[i]

        def number(standing: Standing) -> int:
            if standing not in table:
                table.append(standing)
            return table.index(standing)

        sliding, still = self._closed(facts, slips, i, before, mine, speeds)
        slides, rests = (replace(standing, turned="turn" in kinds) for standing in (Standing(SLIDING), still))
        codes = np.where(sliding, number(slides), number(rests))
        if contact.constraint is None or before not in (None, OPEN):
            return np.full(count, number(Standing(LIFTING))) if "lift" in kinds else codes
        if before == OPEN and "meet" not in kinds:
            return np.full(count, number(Standing(FREE)))
        assert facts is not None
        rate, noise = facts.gap_rate(i), self._rate_noise(facts, i)
        struck = np.where(sliding, number(Standing(SLIDING, struck=True)), number(Standing(still.kind, struck=True)))
        codes = np.where(rate < -noise, struck, codes)
        apart = rate > noise
        if before is None:
            apart |= facts.gap[:, i] > self.gap_noise(facts, i)
        return np.where(apart, number(Standing(FREE)), codes)

    def _closed(
        self,
        facts: Facts | None,
        slips: FloatArray,
        i: int,
        before: str | None,
        mine: Sequence[Watchpoint],
        speeds: FloatArray,
    ) -> tuple[NDArray[np.bool_], Standing]:
        """Return in which cases a contact slides if it is closed (k,), and how it stands in the others."""
        contact, never = self.contacts[i], np.zeros(len(slips), np.bool_)
        if not contact.tangential or contact.regularization is not None:
            return never, Standing(TOUCHING)
        broken = [point.sign for point in mine if point.kind == "break"]
        if broken:
            return never, Standing(GRIPPED, broken=broken[0])
        stopped = any(point.kind == "stop" for point in mine)
        if before == STICK or (stopped and len(contact.tangential) == 1):
            return never, Standing(GRIPPED)
        scale = speeds[:, i]
        if before is None:
            assert facts is not None
            rows = facts.slip_jacobian[:, facts.places[i]]
            scale = np.maximum(scale, np.max(np.sum(np.abs(rows * facts.qdot[:, np.newaxis]), axis=2), axis=1))
        return ~(length(slips[:, i]) <= (STOPPED if stopped else NOISE) * scale), Standing(GRIPPED)

    def gap_noise(self, facts: Facts, i: int) -> FloatArray:
        """Return the size below which a gap counts as zero (k,)."""
        return NOISE * (np.abs(facts.gap[:, i]) + _LENGTH)

    def _rate_noise(self, facts: Facts, i: int) -> FloatArray:
        row = self.contacts[i].constraint
        assert row is not None
        return NOISE * np.sum(np.abs(facts.jacobian[:, row] * facts.qdot), axis=1) + _STILL * facts.largest_rate(row)


def length(vectors: FloatArray) -> FloatArray:
    """Return the lengths of vectors along the last axis."""
    return np.asarray(np.sqrt(np.sum(vectors**2, axis=-1)))
