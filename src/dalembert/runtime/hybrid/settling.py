"""What happens to contacts at an instant: impacts, then the mode in which the motion goes on.

Cases that come from one mode for one reason are settled together, as the ones of a sweep; a single run is one case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...integrators.mode_selection import NOISE
from ...mechanics.equations import ContactRow, Watchpoint
from ...methods.status import Status
from ...reduction.contact_data import ContactData
from ...reduction.modes import CLOSED, OPEN, SLIP, SMOOTH, STICK, Mode
from ...reduction.verdicts import Verdict
from .deciding import FREE, GRIPPED, SLIDING, TOUCHING, Standing, choose
from .facts import Facts, facts_at
from .instants import Instants, Settled
from .quick import Quick
from .standings import Standings, length

__all__ = ["Laws"]


@final
class Laws:
    """The laws of contact of a scene.

    Parameters
    ----------
    data : ContactData
    contacts : sequence of ContactRow
    quick : Quick
        Decisions by kernels, where these do.
    """

    def __init__(self, data: ContactData, contacts: Sequence[ContactRow], quick: Quick) -> None:
        self.data, self.contacts, self.quick = data, tuple(contacts), quick
        self.standings = Standings(contacts)

    def facts(self, t: FloatArray, x: FloatArray, c: FloatArray) -> Facts:
        """Return the facts of cases."""
        return facts_at(self.data, self.contacts, t, x, c)

    def plain(self, facts: Facts) -> Mode:
        """Return the mode of the first case if all that touches is closed, and slips."""
        able = []
        for i, contact in enumerate(self.contacts):
            apart = contact.constraint is not None and facts.gap[0, i] > self.standings.gap_noise(facts, i)[0]
            smooth = SMOOTH if contact.regularization is not None else SLIP
            able.append(OPEN if apart else smooth if contact.tangential else CLOSED)
        return tuple(able)

    def settle(self, now: Instants, mode: Mode | None, fired: Sequence[Watchpoint]) -> Settled:
        """Return how cases go on that come from `mode` because of `fired`; None where nothing is known of them."""
        tried = self._begun(now) if mode is None else self._quickly(now, mode, fired)
        if tried is None:
            return self._slowly(now, mode, fired)
        settled, sure = tried
        left = np.flatnonzero(~sure)
        if len(left):
            settled.put(left, self._slowly(now.part(left), mode, fired))
        return settled

    def _quickly(
        self, now: Instants, mode: Mode, fired: Sequence[Watchpoint]
    ) -> tuple[Settled, NDArray[np.bool_]] | None:
        """Return how cases go on as kernels say, and for which of them that is sure (k,); None where they cannot say.

        A contact that closes may be struck, and where two slip or some may in a plane, zero is a matter of size.
        """
        if not self._plain_enough(mode, fired):
            return None
        slip = self.quick.slips(now.t, now.x, now.c)
        slips = np.stack([slip, np.zeros_like(slip)], axis=2)
        result = Settled.copied(now, np.maximum(now.speeds, np.abs(slip)))
        coded = self.standings.coded(None, slips, now, mode, fired, result.speeds)
        return self._decided(now, slips, coded, result, known=True)

    def _plain_enough(self, mode: Mode, fired: Sequence[Watchpoint]) -> bool:
        meets = any(point.kind == "meet" for point in fired)
        return mode.count(SLIP) <= 1 and not meets and all(len(contact.tangential) < 2 for contact in self.contacts)

    def rulings(self, now: Instants, mode: Mode, fired: Sequence[Watchpoint]) -> dict[int, Verdict | None]:
        """Return by which verdicts cases go on that come from `mode` because of `fired`; None where there is none.

        They are told apart by the contacts whose slip velocities are not zero, as bits.
        """
        if not self._plain_enough(mode, fired):
            return {}
        slip = self.quick.slips(now.t, now.x, now.c)
        speeds = np.maximum(now.speeds, np.abs(slip))
        slips = np.stack([slip, np.zeros_like(slip)], axis=2)
        sliding = ~(np.abs(slip) <= NOISE * speeds) @ (1 << np.arange(len(self.contacts)))
        table, codes = self.standings.coded(None, slips, now, mode, fired, speeds)
        known, found = self.quick.sided(True), dict[int, Verdict | None]()
        for number in np.unique(sliding):
            found[int(number)] = self.quick.verdict(table[int(codes[np.argmax(sliding == number)])], known)
        return found

    def _begun(self, now: Instants) -> tuple[Settled, NDArray[np.bool_]] | None:
        """Return the same as `_quickly` for cases that start, where no contact may be open."""
        if any(
            c.constraint is not None or len(c.tangential) != 1 or c.regularization is not None for c in self.contacts
        ):
            return None
        slip, size, mu, static, restitution = self.quick.starts(now.t, now.x, now.c)
        result = Settled.copied(now, np.maximum(now.speeds, np.abs(slip)))
        sliding = ~(np.abs(slip) <= NOISE * np.maximum(result.speeds, size))
        codes = sliding @ (1 << np.arange(len(self.contacts)))
        table = {
            int(code): [Standing(SLIDING if code >> i & 1 else GRIPPED) for i in range(len(self.contacts))]
            for code in np.unique(codes)
        }
        slips = np.stack([slip, np.zeros_like(slip)], axis=2)
        decided = self._decided(now, slips, (table, codes), result, known=False)
        bad = np.any((mu < 0.0) | (static < mu) | (restitution < 0.0) | (restitution > 1.0), axis=1)
        result.status[bad], result.mode[bad] = int(Status.INITIAL_STATE), -1
        return decided

    def _decided(
        self,
        now: Instants,
        slips: FloatArray,
        coded: tuple[dict[int, list[Standing]], NDArray[np.intp]],
        result: Settled,
        *,
        known: bool,
    ) -> tuple[Settled, NDArray[np.bool_]] | None:
        """Write to `result` what kernels decide; return it, and for which cases they are sure."""
        (table, codes), count = coded, len(now.t)
        sure = np.ones(count, np.bool_)
        for code in table:
            some = np.flatnonzero(codes == code)
            whole = len(some) == count
            here = now if whole else now.part(some)
            directions = _turned_along(slips if whole else slips[some], here.directions)
            cases = here.t, here.x, here.c
            found = self.quick.choose(table[code], cases, directions, here.sides, known=known)
            if found is None:
                return None
            sure[some] = found.sure
            result.x[slice(None) if whole else some, here.x.shape[1] // 2 :] = found.rates
            result.record(some, found.choice)
        return result, sure

    def _slowly(self, now: Instants, mode: Mode | None, fired: Sequence[Watchpoint]) -> Settled:
        """Return how cases go on, by linear systems that may be singular."""
        facts = self.facts(now.t, now.x, now.c)
        count, k = len(facts), len(self.contacts)
        speeds = np.maximum(now.speeds, self._speeds(facts, now, mode))
        slips = np.stack([facts.slips(i) for i in range(k)], axis=1)
        table, codes = self.standings.coded(facts, slips, now, mode, fired, speeds)
        result = Settled.copied(now, speeds)
        for code, alike in table.items():
            some = np.flatnonzero(codes == code)
            here = facts if len(some) == count else facts.part(some)
            self._group(here, now.part(some), alike, result, some, known=mode is not None)
        bad = self._refused(facts, mode)
        result.status[bad], result.mode[bad] = int(Status.INITIAL_STATE), -1
        return result

    def _speeds(self, facts: Facts, now: Instants, mode: Mode | None) -> FloatArray:
        """Return the sizes of the slip speeds: present ones, and what they have lost in the last phase."""
        speeds = np.zeros((len(facts), len(self.contacts)))
        for i in range(len(self.contacts)):
            speeds[:, i] = length(facts.slips(i))
        unsure = any(len(contact.tangential) > 1 for contact in self.contacts)  # whether zero is a matter of size
        if mode is not None and SLIP in mode and (mode.count(SLIP) > 1 or unsure):
            change = facts.solve(facts.accelerating(), mode, now.directions, now.sides).slip
            speeds = np.maximum(speeds, np.nan_to_num(length(change) * np.abs(now.passed)[:, np.newaxis]))
        return speeds

    def _refused(self, facts: Facts, mode: Mode | None) -> NDArray[np.bool_]:
        """Return which cases cannot start: those whose gaps are negative, or whose coefficients make no sense."""
        bad = np.any(facts.mu < 0.0, axis=1) | np.any(facts.mu_static < facts.mu, axis=1)
        bad |= np.any(facts.restitution < 0.0, axis=1) | np.any(facts.restitution > 1.0, axis=1)
        for i, contact in enumerate(self.contacts):
            if contact.constraint is not None and mode is None:
                bad |= facts.gap[:, i] < -self.standings.gap_noise(facts, i)
                bad |= ~facts.pushes_open(i)
        return np.asarray(bad)

    # -- one group of cases that stand alike ----------------------------------------------

    def _group(
        self,
        facts: Facts,
        now: Instants,
        standings: list[Standing],
        result: Settled,
        some: NDArray[np.intp],
        *,
        known: bool = False,
    ) -> None:
        """Settle cases whose contacts stand alike; `known` says that they are pushed as they were before."""
        directions = self._directions(facts, now.directions)
        x, size = now.x.copy(), facts.mass.shape[1]
        if any(standing.struck for standing in standings):
            self._strike(facts, now, standings, directions, result, some)
            return
        choice = choose(facts, standings, facts.accelerating(), directions, now.sides if known else None)
        result.record(some, choice)
        for number, mode in enumerate(choice.modes):
            here = np.flatnonzero(choice.mode == number)
            if len(here) and (STICK in mode or any(standing.kind == TOUCHING for standing in standings)):
                x[here, size:] = (facts if len(here) == len(facts) else facts.part(here)).held(mode)
        result.x[some] = x

    def _strike(
        self,
        facts: Facts,
        now: Instants,
        standings: list[Standing],
        directions: FloatArray,
        result: Settled,
        some: NDArray[np.intp],
    ) -> None:
        """Let an impact happen, and settle what comes after it."""
        after = np.zeros_like(facts.velocity)
        during = []
        for i, (contact, standing) in enumerate(zip(self.contacts, standings, strict=True)):
            if standing.struck:
                row = contact.constraint
                assert row is not None
                after[:, row] = -facts.restitution[:, i] * facts.velocity[:, row]
            grips = standing.kind == SLIDING or (standing.struck and standing.kind == GRIPPED)
            during.append(Standing(GRIPPED if grips else standing.kind, struck=standing.struck))
        choice = choose(facts, during, facts.impact(after), directions)
        x, size = now.x.copy(), facts.mass.shape[1]
        x[:, size:] = choice.motion
        result.status[some] = choice.status
        for number, mode in enumerate(choice.modes):
            here = np.flatnonzero(choice.mode == number)
            if not len(here):
                continue
            part = now.part(here)
            later = replace(part, x=x[here], directions=choice.directions[here], sides=choice.sides[here])
            rebound = facts.part(here)
            bounces = [
                [s.struck and e > 0.0 for s, e in zip(standings, case, strict=True)] for case in rebound.restitution
            ]
            for pattern in sorted({tuple(row) for row in bounces}):
                these = np.array([j for j, row in enumerate(bounces) if tuple(row) == pattern])
                stand = [
                    self._after(standing, state, free)
                    for standing, state, free in zip(standings, mode, pattern, strict=True)
                ]
                group = later.part(these)
                self._group(self.facts(group.t, group.x, group.c), group, stand, result, some[here[these]])
        bad = some[choice.mode < 0]
        result.status[bad] = choice.status[choice.mode < 0]

    def _after(self, standing: Standing, state: str, bounces: bool) -> Standing:
        """Return how a contact stands after an impact that it took in a state."""
        if bounces or state == OPEN:
            return Standing(FREE)
        if state in (SLIP, STICK):
            return Standing(SLIDING if state == SLIP else GRIPPED)
        return Standing(TOUCHING)

    def _directions(self, facts: Facts, before: FloatArray) -> FloatArray:
        """Return unit vectors along the slip velocities, the former ones where there is none."""
        return _turned_along(np.stack([facts.slips(i) for i in range(len(self.contacts))], axis=1), before)


def _turned_along(slips: FloatArray, before: FloatArray) -> FloatArray:
    """Return unit vectors along slip velocities (k, n_contacts, 2), the former ones where there is none."""
    size = length(slips)[:, :, None]
    return np.where(size > 0.0, slips / np.where(size > 0.0, size, 1.0), before)
