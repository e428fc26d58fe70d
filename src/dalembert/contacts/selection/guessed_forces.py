"""Guesses of contact forces: iterations, and a linear complementarity problem, for combinations too many to try.

Iterations go from one contact to the other, the others being as they are. Each is pushed by what its gap misses, and
rubbed by what it slips; its friction is then brought back into the cone (M. Jean, Computer Methods in Applied Mechanics
and Engineering 177 (1999) 235-257). Forces that stay as they are obey Coulomb's law: in a plane both components of a
step have one length.

Of contacts that may stick along a line, forces at rest are found by Lemke's method: w = M z + q >= 0, z >= 0, w . z = 0
with z = (N, friction forwards and backwards, slip): accelerations of gaps, of slip both ways and what friction leaves
of mu N are not negative (D. E. Stewart and J. C. Trinkle, International Journal for Numerical Methods in Engineering 39
(1996) 2673-2691). Pivots lead from an artificial variable to a solution (R. W. Cottle, J.-S. Pang and R. E. Stone, The
Linear Complementarity Problem, 1992, section 4.4). Forces need not be determined: redundant contacts do no harm.
"""

from __future__ import annotations

from ...subset.compiled_subset import compiled_subset, sqrt
from ..contact_system import OPEN, SLIP, STICK, ContactSystem
from .contact_responses import load_compliances, normal_load
from .mode_candidates import GRIPPED, RELEASED, Candidates, choose_all, combine, find_option
from .mode_laws import friction_limit

_SWEEPS, _LEAST_SHARE, _CLOSE = 400, 0.25, 1e-10
"""Most iterations over all contacts with steps of one length; the least of these for friction in a plane, halved where
longer ones do not converge; and the change of the forces, relative to the largest, at which iterations end."""

_FULL = 1.0 - 1e-6
"""Share of the most friction from which iterations on the forces let a contact slip."""


@compiled_subset
def _excess(system: ContactSystem, pick: Candidates, row: int) -> float:
    """Return the acceleration of slip, or of a gap, that the present guess of the forces leaves."""
    value = system.compliances[row, 0]
    for j in range(pick.guessed.size):
        value += system.compliances[row, 1 + j] * pick.guessed[j]
    return value


@compiled_subset
def _guessed_press(system: ContactSystem, pick: Candidates, i: int) -> float:
    """Return the present guess of the normal reaction of a contact, or of the one whose further law it is."""
    leader = system.leader[i]
    return pick.guessed[system.slips + leader] + system.restored[leader]


@compiled_subset
def _step_of_friction(system: ContactSystem, pick: Candidates, i: int, share: float) -> None:
    """Let the guessed friction of a contact oppose its slip. In a plane one step length keeps the direction of slip."""
    guessed, first, last, ease = pick.guessed, system.first[i], system.first[i] + system.width[i] - 1, 0.0
    for r in range(first, last + 1):
        ease += system.compliances[r, 1 + r]
    if ease > 0.0:
        one, other = _excess(system, pick, first) / ease, _excess(system, pick, last) / ease
        if first == last:
            guessed[first] -= one
        else:
            guessed[first] -= share * one
            guessed[last] -= share * other


@compiled_subset
def _guess_contact(system: ContactSystem, pick: Candidates, i: int, share: float) -> float:
    """Improve the guess of the forces of one contact; return the largest change."""
    guessed, row, first = pick.guessed, system.slips + i, system.first[i]
    ease, press, last = system.compliances[row, 1 + row], guessed[row], first + system.width[i] - 1
    if ease > 0.0:
        guessed[row] = max(press - _excess(system, pick, row) / ease, 0.0)
    if system.given[i] != 0:
        guessed[row] = normal_load(system, i)
    change, sticks = abs(guessed[row] - press), find_option(pick, i, STICK, 0, 0) >= 0
    pressing = _guessed_press(system, pick, i)
    if system.width[i] == 0:
        return change
    before, other = guessed[first], guessed[last]
    if sticks:
        _step_of_friction(system, pick, i, share)
        used = 0.0
        for r in range(first, last + 1):
            used += guessed[r] * guessed[r]
        most = friction_limit(system, pick, i) * pressing
        if used > most * most:
            for r in range(first, last + 1):
                guessed[r] *= most / sqrt(used)
    else:
        for a in range(system.width[i]):
            guessed[first + a] = -system.mu[i] * pressing * pick.now.along[i, a]
    return max(change, abs(guessed[first] - before), abs(guessed[last] - other))


@compiled_subset
def _iterate(system: ContactSystem, pick: Candidates, share: float) -> bool:
    """Improve the guess of all forces, one contact after the other; return whether it converges."""
    for _ in range(_SWEEPS):
        change, largest = 0.0, 0.0
        for i in range(system.contacts):
            if pick.now.mode[i] != OPEN:
                change = max(change, _guess_contact(system, pick, i, share))
                largest = max(largest, pick.guessed[system.slips + i])
        if change <= _CLOSE * largest:
            return True
    return False


@compiled_subset
def guess_forces(system: ContactSystem, pick: Candidates) -> None:
    """Choose the combination that iterations on the forces suggest: one contact at a time, the others as they are."""
    for j in range(pick.guessed.size):
        pick.guessed[j] = 0.0
    choose_all(pick, False)
    combine(system, pick)
    load_compliances(system)
    share, least = 1.0, 1.0
    for i in range(system.contacts):
        least = _LEAST_SHARE if system.width[i] > 1 else least
    while share >= least and not _iterate(system, pick, share):
        share *= 0.5
    for i in range(system.contacts):
        press, opened, used = pick.guessed[system.slips + i], find_option(pick, i, OPEN, 0, 0), 0.0
        for r in range(system.first[i], system.first[i] + system.width[i]):
            used += pick.guessed[r] * pick.guessed[r]
        side = 0 if system.restored[i] == 0.0 else 1 if press > 0.0 else RELEASED
        sticks, most = find_option(pick, i, STICK, side, 0), friction_limit(system, pick, i)
        if press == 0.0 and opened >= 0:
            pick.choice[i] = opened
        elif sticks >= 0 and sqrt(used) >= _FULL * most * _guessed_press(system, pick, i):
            way = 0 if system.width[i] != 1 else -1 if pick.guessed[system.first[i]] > 0.0 else 1
            pick.choice[i] = max(find_option(pick, i, SLIP, side, way), 0)
        elif side != 0:
            pick.choice[i] = sticks if sticks >= 0 else max(find_option(pick, i, system.closed[i], side, 0), 0)


@compiled_subset
def guess_directions(system: ContactSystem, pick: Candidates) -> bool:
    """Write the directions in which iterations on the forces let contacts in a plane begin to slip; return if any."""
    guess_forces(system, pick)
    for i in range(system.contacts):
        r, slipping = system.first[i], pick.kind[i] == GRIPPED and system.width[i] > 1
        size = sqrt(pick.guessed[r] * pick.guessed[r] + pick.guessed[r + 1] * pick.guessed[r + 1]) if slipping else 0.0
        if size > 0.0:
            pick.found.guided = 1
            for a in range(2):
                pick.given.along[i, a] = -pick.guessed[r + a] / size
    return pick.found.guided != 0


_PIVOTS, _TINY = 20, 1e-11
"""Most pivots for each row, and entries of the table that count as zero."""


@compiled_subset
def _may_stick(system: ContactSystem, pick: Candidates, i: int) -> bool:
    """Return whether a contact along a line may stick."""
    sticks = False
    for n in range(pick.option_count[i]):
        sticks = sticks or pick.options[i, 3 * n] == STICK
    return sticks and system.width[i] == 1


@compiled_subset
def _may_close(pick: Candidates, i: int) -> bool:
    """Return whether a contact may be closed."""
    closes = False
    for n in range(pick.option_count[i]):
        closes = closes or pick.options[i, 3 * n] != OPEN
    return closes


@compiled_subset
def _pressed(system: ContactSystem, pick: Candidates, row: int, i: int) -> float:
    """Return the acceleration along a row for a unit of a normal reaction, with the friction of laws that slide."""
    value = system.compliances[row, 1 + system.slips + i]
    for law in range(system.contacts):
        if system.leader[law] == i and not _may_stick(system, pick, law):
            for a in range(system.width[law]):
                r = system.first[law] + a
                value -= system.mu[law] * pick.now.along[law, a] * system.compliances[row, 1 + r]
    return value


@compiled_subset
def _set_row(system: ContactSystem, pick: Candidates, place: int, row: int, sign: float) -> None:
    """Write a row of the table: w = q + M z of the acceleration along a row of the contacts."""
    table, k, s = pick.table, system.contacts, system.slips
    m, excess = k + 3 * s, system.compliances[row, 0]
    for j in range(k):
        if _may_close(pick, j) and system.leader[j] == j:
            table[place, m + j] = -sign * _pressed(system, pick, row, j)
        if _may_stick(system, pick, j):
            r = system.first[j]
            table[place, m + k + r] = -sign * system.compliances[row, 1 + r]
            table[place, m + k + s + r] = sign * system.compliances[row, 1 + r]
        if system.restored[j] > 0.0:  # friction of what it gives back
            given = _pressed(system, pick, row, j) - system.compliances[row, 1 + system.slips + j]
            excess += given * system.restored[j]
    table[place, 2 * m + 1] = sign * excess


@compiled_subset
def _set_table(system: ContactSystem, pick: Candidates) -> None:
    """Write the table (m, 2 m + 2) of w - M z - z0 = q; rows of contacts that have no such law are w = 1."""
    table, k, s = pick.table, system.contacts, system.slips
    m = k + 3 * s
    for place in range(m):
        for j in range(2 * m + 2):
            table[place, j] = 0.0
        table[place, place], table[place, 2 * m], table[place, 2 * m + 1] = 1.0, -1.0, 1.0
        pick.basis[place] = place
    for i in range(k):
        leader = system.leader[i]
        if _may_close(pick, i) and leader == i:
            _set_row(system, pick, i, s + i, 1.0)
        if _may_stick(system, pick, i):
            r = system.first[i]
            up, down, slip = k + r, k + s + r, k + 2 * s + r
            _set_row(system, pick, up, r, 1.0)
            _set_row(system, pick, down, r, -1.0)
            table[up, m + slip] = table[down, m + slip] = -1.0
            table[slip, m + leader], table[slip, m + up], table[slip, m + down] = -system.mu[i], 1.0, 1.0
            table[slip, 2 * m + 1] = system.mu[i] * system.restored[leader]


@compiled_subset
def _pivot(pick: Candidates, leaving: int, entering: int) -> None:
    """Let a variable enter the basis in a row."""
    table, width = pick.table, pick.table.shape[1]
    factor = table[leaving, entering]
    for j in range(width):
        table[leaving, j] /= factor
    for i in range(table.shape[0]):
        factor = table[i, entering]
        if i != leaving and factor != 0.0:
            for j in range(width):
                table[i, j] -= factor * table[leaving, j]
    pick.basis[leaving] = entering


@compiled_subset
def _leaves(pick: Candidates, entering: int) -> int:
    """Return the row whose variable vanishes first as one grows; -1 where none does. The artificial one goes first.

    Ties are broken by the first column in which the rows differ, which no cycle survives.
    """
    table, best = pick.table, -1
    m = table.shape[0]
    for i in range(m):
        if table[i, entering] <= _TINY:
            continue
        if best < 0:
            best = i
            continue
        own, other = table[i, 2 * m + 1] / table[i, entering], table[best, 2 * m + 1] / table[best, entering]
        column = 0
        while abs(own - other) <= _TINY * (1.0 + abs(other)) and column < m:
            if pick.basis[i] == 2 * m or pick.basis[best] == 2 * m:
                own, other = (0.0, 1.0) if pick.basis[i] == 2 * m else (1.0, 0.0)
                break
            own, other = table[i, column] / table[i, entering], table[best, column] / table[best, entering]
            column += 1
        if own < other:
            best = i
    return best


@compiled_subset
def _solved(pick: Candidates) -> bool:
    """Find a complementary solution by pivots from the artificial variable; return whether there is one."""
    table, m, leaving = pick.table, pick.table.shape[0], 0
    for i in range(1, m):
        if table[i, 2 * m + 1] < table[leaving, 2 * m + 1]:
            leaving = i
    entering, left = 2 * m, _PIVOTS * m
    solved = not table[leaving, 2 * m + 1] < 0.0
    while not solved and leaving >= 0 and left > 0:
        gone = pick.basis[leaving]
        _pivot(pick, leaving, entering)
        solved = gone == 2 * m
        entering = gone + m if gone < m else gone - m
        if not solved:
            leaving = _leaves(pick, entering)
        left -= 1
    return solved


@compiled_subset
def _value(pick: Candidates, variable: int) -> float:
    """Return the value of a variable z in the solution."""
    m, value = pick.table.shape[0], 0.0
    for i in range(m):
        if pick.basis[i] == m + variable:
            value = pick.table[i, 2 * m + 1]
    return value


@compiled_subset
def choose_complementary(system: ContactSystem, pick: Candidates) -> bool:
    """Choose the combination of a complementary solution; return whether there is one.

    ``compliances`` are known, and the present combination has the directions of contacts that slide.
    """
    _set_table(system, pick)
    if not _solved(pick):
        return False
    k, s = system.contacts, system.slips
    for i in range(k):
        r, state, way = system.first[i], OPEN, 0
        leader = system.leader[i]
        more, gives = _value(pick, leader) > 0.0, system.restored[leader] > 0.0
        if more or gives:
            state = system.closed[i]
            if _may_stick(system, pick, i) and _value(pick, k + 2 * s + r) <= 0.0:
                state = STICK
            elif _may_stick(system, pick, i):
                way = -1 if _value(pick, k + r) > 0.0 else 1
        found = find_option(pick, i, state, 0 if not gives or leader != i else 1 if more else RELEASED, way)
        pick.choice[i] = found if found >= 0 else 0
    return True
