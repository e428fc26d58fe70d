"""Triangles and lines of shapes, on the axes of their body."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen


@final
@frozen(eq=False)
class Triangles:
    """A surface.

    Attributes
    ----------
    vertices : ndarray (n, 3)
    faces : ndarray (m, 3)
        Numbers of the vertices of each triangle.
    marks : tuple of ndarray (k, 3)
        Lines on the surface that show how it turns.
    """

    vertices: FloatArray
    faces: NDArray[np.intp]
    marks: tuple[FloatArray, ...] = ()

    def placed(self, rotation: FloatArray, offset: FloatArray) -> Triangles:
        """Return the surface on other axes, to which a matrix (3, 3) turns it, moved by an offset (3,)."""
        marks = tuple(mark @ rotation.T + offset for mark in self.marks)
        return Triangles(self.vertices @ rotation.T + offset, self.faces, marks)

    def thinned(self, most: int) -> Triangles:
        """Return the surface with at most so many vertices: those in one cube of a grid become their mean."""
        vertices, faces, cells = self.vertices, self.faces, 2 * int(np.sqrt(most)) + 2
        low, size = vertices.min(axis=0), float(np.max(np.ptp(vertices, axis=0))) or 1.0
        while len(vertices) > most and cells > 1:
            cells = max(3 * cells // 4, 1)
            cube = np.minimum((cells * (self.vertices - low) / size).astype(int), cells - 1)
            _, place, count = np.unique(cube, axis=0, return_inverse=True, return_counts=True)
            place = place.reshape(-1)
            sums = [np.bincount(place, column) / count for column in self.vertices.T]
            vertices, faces = np.stack(sums, axis=1), place[self.faces]
        apart = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        return Triangles(vertices, np.unique(faces[apart], axis=0), self.marks)


def frame_of(axis: FloatArray) -> FloatArray:
    """Return a rotation (3, 3) whose third column is along an axis (3,)."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _circle(radius: float, count: int) -> FloatArray:
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle], axis=1)


def sphere(radius: float, rings: int = 10, count: int = 20) -> Triangles:
    """Return a sphere, marked by two great circles."""
    polar, around = np.linspace(0.0, np.pi, rings + 1), 2.0 * np.pi * np.arange(count) / count
    p, a = (x.ravel() for x in np.meshgrid(polar, around, indexing="ij"))
    vertices = radius * np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=1)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(rings), np.arange(count), indexing="ij"))
    here, right = i * count + j, i * count + (j + 1) % count
    faces = np.concatenate(
        [np.stack([here, right, here + count], 1), np.stack([right, right + count, here + count], 1)]
    )
    equator = _circle(1.003 * radius, 40)
    return Triangles(vertices, faces, (equator, equator[:, [2, 0, 1]]))


def disk(radius: float, axis: FloatArray, count: int = 36) -> Triangles:
    """Return a disk, marked by its rim and two spokes."""
    turned = frame_of(axis)
    rim = _circle(radius, count)
    vertices = np.concatenate([np.zeros((1, 3)), rim[:-1]])
    k = np.arange(count)
    faces = np.stack([0 * k, 1 + k, 1 + (k + 1) % count], axis=1)
    spokes = [np.array([rim[0], rim[count // 2]]), np.array([rim[count // 4], rim[3 * count // 4]])]
    return Triangles(vertices @ turned.T, faces, tuple(line @ turned.T for line in (rim, *spokes)))


def box(edges: FloatArray) -> Triangles:
    """Return a box with edges (3,) along the axes, marked by these."""
    corners = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)]) * edges
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    path = corners[[0, 1, 3, 2, 0, 4, 5, 7, 6, 4, 5, 1, 3, 7, 6, 2]]
    return Triangles(corners, np.array(faces), (path,))


def cylinder(radius: float, length: float, axis: FloatArray, count: int = 24) -> Triangles:
    """Return a closed cylinder, marked by its rims and a line along it."""
    turned, ring = frame_of(axis), _circle(radius, count)
    up = np.array([0.0, 0.0, 0.5 * length])
    vertices = np.concatenate([ring[:-1] - up, ring[:-1] + up, [-up], [up]])
    k = np.arange(count)
    n = (k + 1) % count
    lower, upper = np.full(count, 2 * count), np.full(count, 2 * count + 1)
    parts = [(k, n, k + count), (n, n + count, k + count), (lower, n, k), (upper, k + count, n + count)]
    marks = (ring - up, ring + up, np.array([ring[0] - up, ring[0] + up]))
    return Triangles(
        vertices @ turned.T, np.concatenate([np.stack(p, 1) for p in parts]), tuple(m @ turned.T for m in marks)
    )


def square(size: float, normal: FloatArray) -> Triangles:
    """Return a square around the origin."""
    half = 0.5 * size
    corners = np.array([[-half, -half, 0.0], [half, -half, 0.0], [half, half, 0.0], [-half, half, 0.0]])
    return Triangles(corners @ frame_of(normal).T, np.array([[0, 1, 2], [0, 2, 3]]))


def coil(start: FloatArray, end: FloatArray, radius: float, coils: int) -> FloatArray:
    """Return helices (n_t, k, 3) from points (n_t, 3) to others, straight for a tenth of the way at both ends."""
    share = np.linspace(0.0, 1.0, 16 * coils + 1)
    angle = 2.0 * np.pi * coils * share
    place = np.concatenate([[0.0], 0.1 + 0.8 * share, [1.0]])
    across = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = np.concatenate([np.zeros((1, 2)), across, np.zeros((1, 2))])
    out = np.empty((len(start), len(place), 3))
    for k, (a, b) in enumerate(zip(start, end, strict=True)):
        along = b - a
        turned = frame_of(along) if np.linalg.norm(along) > 0.0 else np.eye(3)
        out[k] = a + place[:, np.newaxis] * along + across @ turned[:, :2].T
    return out
