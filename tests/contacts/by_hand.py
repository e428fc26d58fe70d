"""Laws of contact and impact by trial of all combinations in NumPy: each law of friction slips or sticks on its own."""

from itertools import product

import numpy as np

__all__ = ["after_impact", "solutions"]

EPS = 1e-12


def solutions(G, u, mus, least, owners=None):
    """Return the forces of all combinations that obey the laws of contact: k normal ones, then s of friction laws.

    `G` (k + s, k + s) maps them to changes of u, and `mus` (s,) are the coefficients of the laws, each under the normal
    force with its number in `owners` (s,), by default one each. Normal forces are at least `least` (k,): a contact that
    is pushed more does not separate.
    """
    k, s, found = len(least), len(mus), []
    owners, one = list(range(s)) if owners is None else owners, np.eye(len(u))
    for closed, slips in product(product((0, 1), repeat=k), product((0, 1, -1), repeat=s)):
        rows, right = np.zeros((k + s, k + s)), np.zeros(k + s)
        for i in range(k):
            rows[i], right[i] = (G[i], -u[i]) if closed[i] else (one[i], least[i])
        for t, (way, owner) in enumerate(zip(slips, owners, strict=True), k):
            rows[t], right[t] = (G[t], -u[t]) if way == 0 else (one[t], 0.0)
            if way != 0:
                rows[t, owner] = way * mus[t - k]
        if abs(np.linalg.det(rows)) < EPS:
            continue
        P = np.linalg.solve(rows, right)
        v = u + G @ P
        lawful = all(P[i] >= least[i] - EPS and v[i] >= -EPS for i in range(k)) and all(
            abs(P[t]) <= mus[t - k] * P[owner] + EPS if way == 0 else way * v[t] >= -EPS
            for t, (way, owner) in enumerate(zip(slips, owners, strict=True), k)
        )
        if lawful and not any(np.allclose(P, other, atol=1e-9) for other in found):
            found.append(P)
    return found


def after_impact(M, rows, rates, mus, es, owners=None, *, poisson=True):
    """Return the rates after an impact, by rows of gap and slip velocities (k + s, n); None where they are not unique.

    By Newton's law contacts that approach leave with `es` (k,) times their rates, where that contradicts nothing.
    """
    k, inverse = len(es), np.linalg.inv(M)
    G, u = rows @ inverse @ rows.T, rows @ rates
    first = solutions(G, u if poisson else u + np.append(es * u[:k], np.zeros(len(mus))), mus, np.zeros(k), owners)
    if len(first) != 1:
        return None
    second = solutions(G, u + G @ first[0], mus, es * first[0][:k], owners) if poisson else [0.0 * first[0]]
    return None if len(second) != 1 else rates + inverse @ rows.T @ (first[0] + second[0])
