"""Contact forces at rest as a linear complementarity problem, solved by Lemke's method.

Of contacts that may stick along a line, w = M z + q >= 0, z >= 0, w . z = 0 with z = (N, friction forwards and
backwards, slip): accelerations of gaps, of slip both ways and what friction leaves of mu N are not negative (D. E.
Stewart and J. C. Trinkle, International Journal for Numerical Methods in Engineering 39 (1996) 2673-2691). Pivots lead
from an artificial variable to a solution (R. W. Cottle, J.-S. Pang and R. E. Stone, The Linear Complementarity Problem,
1992, section 4.4). Forces need not be determined: redundant contacts do no harm.
"""

from __future__ import annotations

from ...subset.compiled_subset import compiled_subset
from ..contact_system import OPEN, STICK, ContactSystem
from .mode_candidates import RELEASED, Candidates, find_option

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
