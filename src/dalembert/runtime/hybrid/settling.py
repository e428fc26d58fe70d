"""What happens to contacts at an instant: impacts, then the mode in which the motion goes on.

Cases that come from one mode for one reason are settled together, as the ones of a sweep; a single run is one case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...integrators.status import Status
from ...mechanics.equations import ContactRow, Watchpoint
from ...reduction.contact_data import ContactData
from ...reduction.modes import CLOSED, OPEN, SLIP, SMOOTH, STICK, Mode
from .deciding import FREE, GRIPPED, LIFTING, SLIDING, TOUCHING, Choice, Standing, choose
from .facts import Facts, FloatArray, facts_at
from .quick import Quick

__all__ = ["Instants", "Laws", "Settled", "placed"]

NOISE = 1e-8
"""Share of a velocity, or of a position, below which it counts as zero."""

STOPPED = 1e-5
"""Share of the slip velocities of a run below which one along two directions has come to rest."""

_LENGTH = 1.0001
"""What gaps are compared with beside their own size."""


@final
@dataclass(frozen=True, eq=False)
class Instants:
    """Cases at an instant: times (k,), states (q, q_dot) (k, 2 n_q), parameters (k, n_p), and what they slip with.

    `passed` (k,) is how long the last phase was, `directions` (k, n_contacts, 2) and `sides` (k, n_contacts) what it
    slipped with, and `speeds` (k, n_contacts) the sizes of the slip speeds so far.
    """

    t: FloatArray
    x: FloatArray
    c: FloatArray
    directions: FloatArray
    sides: FloatArray
    speeds: FloatArray
    passed: FloatArray

    @classmethod
    def starting(cls, t: FloatArray, x: FloatArray, c: FloatArray, contacts: int) -> Instants:
        """Return cases of which nothing else is known."""
        count = len(t)
        forward = np.tile(np.array([1.0, 0.0]), (count, contacts, 1))
        return cls(t, x, c, forward, np.ones((count, contacts)), np.zeros((count, contacts)), np.zeros(count))

    def part(self, some: NDArray[np.intp] | slice) -> Instants:
        """Return some of the cases; a slice gives views."""
        fields = (self.t, self.x, self.c, self.directions, self.sides, self.speeds, self.passed)
        return Instants(*(values[some] for values in fields))


def placed(some: NDArray[np.intp]) -> NDArray[np.intp] | slice:
    """Return numbers that rise, as a slice where none is left out."""
    if len(some) and int(some[-1]) - int(some[0]) + 1 == len(some):
        return slice(int(some[0]), int(some[-1]) + 1)
    return some


@final
@dataclass(frozen=True, eq=False)
class Settled:
    """How cases go on.

    Attributes
    ----------
    table : list of Mode
        The modes that occur.
    mode : ndarray (k,) of int
        Number of the mode of each case, -1 where the status is not SUCCESS.
    x, directions, sides, speeds
        As in `Instants`.
    status : ndarray (k,) of int
    """

    table: list[Mode]
    mode: NDArray[np.intp]
    x: FloatArray
    directions: FloatArray
    sides: FloatArray
    speeds: FloatArray
    status: NDArray[np.int64]

    @classmethod
    def copied(cls, now: Instants, speeds: FloatArray) -> Settled:
        """Return cases of which nothing is decided yet."""
        count = len(now.t)
        x, directions, sides = now.x.copy(), now.directions.copy(), now.sides.copy()
        return cls([], np.full(count, -1), x, directions, sides, speeds, np.zeros(count, np.int64))

    def put(self, cases: NDArray[np.intp], other: Settled) -> None:
        """Replace what is said of some cases."""
        for name in ("x", "directions", "sides", "speeds", "status"):
            getattr(self, name)[cases] = getattr(other, name)
        self.mode[cases] = -1
        for number, mode in enumerate(other.table):
            self.take(mode, cases[other.mode == number])

    def part(self, some: NDArray[np.bool_]) -> Settled:
        """Return some of the cases."""
        fields = (self.mode, self.x, self.directions, self.sides, self.speeds, self.status)
        return Settled(self.table, *(values[some] for values in fields))

    def record(self, cases: NDArray[np.intp], choice: Choice) -> None:
        """Take down what was chosen for some cases."""
        place = slice(None) if len(cases) == len(self.status) else cases
        self.status[place] = choice.status
        self.directions[place], self.sides[place] = choice.directions, choice.sides
        for number, mode in enumerate(choice.modes):
            here = choice.mode == number
            if np.any(here):
                self.take(mode, cases[here])

    def take(self, mode: Mode, cases: NDArray[np.intp]) -> None:
        """Put cases into a mode."""
        if mode not in self.table:
            self.table.append(mode)
        self.mode[cases] = self.table.index(mode)


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

    def facts(self, t: FloatArray, x: FloatArray, c: FloatArray) -> Facts:
        """Return the facts of cases."""
        return facts_at(self.data, self.contacts, t, x, c)

    def plain(self, facts: Facts) -> Mode:
        """Return the mode of the first case if all that touches is closed, and slips."""
        able = []
        for i, contact in enumerate(self.contacts):
            apart = contact.constraint is not None and facts.gap[0, i] > self._gap_noise(facts, i)[0]
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
        meets = {point.contact for point in fired if point.kind == "meet"}
        if mode.count(SLIP) > 1 or any(len(contact.tangential) > 1 for contact in self.contacts) or meets:
            return None
        slip = self.quick.slips(now.t, now.x, now.c)
        slips = np.stack([slip, np.zeros_like(slip)], axis=2)
        result = Settled.copied(now, np.maximum(now.speeds, np.abs(slip)))
        table, codes = self._coded(None, slips, now, mode, fired, result.speeds)
        known = not any(point.kind == "turn" for point in fired)
        return self._decided(now, slips, (table, codes), result, known=known)

    def _begun(self, now: Instants) -> tuple[Settled, NDArray[np.bool_]] | None:
        """Return the same as `_quickly` for cases that start, where no contact may be open."""
        if any(c.constraint is not None or len(c.tangential) != 1 or c.regularization is not None for c in self.contacts):
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

    def _coded(
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
            found.append(Standing(GRIPPED, broken=broken[0] if broken else None))
        return found

    def _slowly(self, now: Instants, mode: Mode | None, fired: Sequence[Watchpoint]) -> Settled:
        """Return how cases go on, by linear systems that may be singular."""
        facts = self.facts(now.t, now.x, now.c)
        count, k = len(facts), len(self.contacts)
        speeds = np.maximum(now.speeds, self._speeds(facts, now, mode))
        slips = np.stack([facts.slips(i) for i in range(k)], axis=1)
        table, codes = self._coded(facts, slips, now, mode, fired, speeds)
        result = Settled.copied(now, speeds)
        for code, alike in table.items():
            some = np.flatnonzero(codes == code)
            here = facts if len(some) == count else facts.part(some)
            known = mode is not None and not any(point.kind == "turn" for point in fired)
            self._group(here, now.part(some), alike, result, some, known=known)
        bad = self._refused(facts, mode)
        result.status[bad], result.mode[bad] = int(Status.INITIAL_STATE), -1
        return result

    def _speeds(self, facts: Facts, now: Instants, mode: Mode | None) -> FloatArray:
        """Return the sizes of the slip speeds: present ones, and what they have lost in the last phase."""
        speeds = np.zeros((len(facts), len(self.contacts)))
        for i in range(len(self.contacts)):
            speeds[:, i] = _length(facts.slips(i))
        unsure = any(len(contact.tangential) > 1 for contact in self.contacts)  # whether zero is a matter of size
        if mode is not None and SLIP in mode and (mode.count(SLIP) > 1 or unsure):
            change = facts.solve(facts.accelerating(), mode, now.directions, now.sides).slip
            speeds = np.maximum(speeds, np.nan_to_num(_length(change) * np.abs(now.passed)[:, np.newaxis]))
        return speeds

    def _refused(self, facts: Facts, mode: Mode | None) -> NDArray[np.bool_]:
        """Return which cases cannot start: those whose gaps are negative, or whose coefficients make no sense."""
        bad = np.any(facts.mu < 0.0, axis=1) | np.any(facts.mu_static < facts.mu, axis=1)
        bad |= np.any(facts.restitution < 0.0, axis=1) | np.any(facts.restitution > 1.0, axis=1)
        for i, contact in enumerate(self.contacts):
            if contact.constraint is not None and mode is None:
                bad |= facts.gap[:, i] < -self._gap_noise(facts, i)
                bad |= ~facts.pushes_open(i)
        return np.asarray(bad)

    def _gap_noise(self, facts: Facts, i: int) -> FloatArray:
        return NOISE * (np.abs(facts.gap[:, i]) + _LENGTH)

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
        codes = np.where(sliding, number(Standing(SLIDING)), number(still))
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
            apart |= facts.gap[:, i] > self._gap_noise(facts, i)
        return np.where(apart, number(Standing(FREE)), codes)

    def _rate_noise(self, facts: Facts, i: int) -> FloatArray:
        row = self.contacts[i].constraint
        assert row is not None
        return NOISE * np.sum(np.abs(facts.jacobian[:, row] * facts.qdot), axis=1)

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
        return ~(_length(slips[:, i]) <= (STOPPED if stopped else NOISE) * scale), Standing(GRIPPED)

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


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.sum(vectors**2, axis=-1)))


def _turned_along(slips: FloatArray, before: FloatArray) -> FloatArray:
    """Return unit vectors along slip velocities (k, n_contacts, 2), the former ones where there is none."""
    size = _length(slips)[:, :, None]
    return np.where(size > 0.0, slips / np.where(size > 0.0, size, 1.0), before)
