"""Surfaces from files: the triangles of STL, OBJ, DAE (COLLADA) and MuJoCo's MSH, without colours and textures."""

from __future__ import annotations

from itertools import pairwise
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError
from ..scene.shape_meshes import Triangles
from .robot_files import Element, FileReader

FORMATS = (".stl", ".obj", ".dae", ".msh")
"""Ends of the names of files that are read."""

_HEADER = 84
"""Bytes of a binary STL file before its triangles: a text, and their number."""

_FACET = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("unused", "<u2")])


def read_mesh(path: str | PathLike[str], name: str = "mesh") -> Triangles:
    """Return the surface of a file.

    Raises
    ------
    OptionError
        For a file that cannot be read, has another format, or no triangles.
    """
    file = Path(path)
    reader = {".stl": _stl, ".obj": _obj, ".dae": _dae, ".msh": _msh}.get(file.suffix.lower())
    if reader is None:
        raise OptionError(f"shape {name!r}: {file.name!r} has none of the formats {', '.join(FORMATS)}")
    try:
        vertices, faces = reader(file)
    except (OSError, ValueError, IndexError, KeyError) as reason:
        why = (isinstance(reason, OSError) and reason.strerror) or reason
        raise OptionError(f"shape {name!r}: {file.name!r} cannot be read: {why}") from None
    if not len(faces):
        raise OptionError(f"shape {name!r}: {file.name!r} has no triangles")
    return Triangles(vertices, faces)


def _stl(file: Path) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return vertices and faces of a binary or a text file, which has another size than its head would say."""
    data = file.read_bytes()
    count = int.from_bytes(data[_HEADER - 4 : _HEADER], "little")
    if len(data) == _HEADER + count * _FACET.itemsize:
        corners = np.frombuffer(data, _FACET, count, _HEADER)["vertices"].reshape(-1, 3).astype(float)
    else:
        words = data.decode(errors="replace").split()
        places = [i for i, word in enumerate(words) if word.lower() == "vertex"]
        corners = np.array([[float(x) for x in words[i + 1 : i + 4]] for i in places]).reshape(-1, 3)
    vertices, faces = np.unique(corners, axis=0, return_inverse=True)
    return vertices, faces.reshape(-1, 3)


def _obj(file: Path) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return vertices and faces; polygons are fans, those of four corners from an end of the shorter diagonal."""
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    for line in file.read_text(errors="replace").splitlines():
        head, *words = line.split() or [""]
        if head == "v":
            vertices.append([float(word) for word in words[:3]])
        elif head == "f":
            numbers = [int(word.partition("/")[0]) for word in words]
            polygons.append([number - 1 if number > 0 else len(vertices) + number for number in numbers])
    corners = np.array(vertices).reshape(-1, 3)
    faces = [triangle for polygon in polygons for triangle in _fan(_from_short_diagonal(polygon, corners))]
    return corners, np.array(faces, dtype=np.intp).reshape(-1, 3)


def _from_short_diagonal(polygon: list[int], corners: FloatArray) -> list[int]:
    """Return a polygon from an end of its shorter diagonal on, if it has four corners: so it is parted in MuJoCo."""
    if len(polygon) != 4:
        return polygon
    a, b, c, d = corners[polygon]
    return [*polygon[1:], polygon[0]] if np.sum((d - b) ** 2) <= np.sum((c - a) ** 2) else polygon


def _msh(file: Path) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return vertices and faces: four numbers of items, then vertices, normals, texture coordinates and triangles."""
    data = file.read_bytes()
    vertices, normals, textures, faces = (int(count) for count in np.frombuffer(data, "<i4", 4))
    place = 4 * (4 + 3 * vertices + 3 * normals + 2 * textures)
    if min(vertices, normals, textures, faces) < 0 or len(data) != place + 12 * faces:
        raise ValueError("its size is not that of its numbers of vertices and triangles")
    corners = np.frombuffer(data, "<f4", 3 * vertices, 16).reshape(-1, 3).astype(float)
    return corners, np.frombuffer(data, "<i4", 3 * faces, place).reshape(-1, 3).astype(np.intp)


# COLLADA: geometries in a tree of nodes, with a unit and an axis that points up.

_UP = {
    "X_UP": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "Y_UP": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "Z_UP": np.eye(3),
}


def _dae(file: Path) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return vertices and faces of all geometries of the nodes of a file, in metres, z upwards."""
    root = FileReader(file, "COLLADA").root
    asset = [child for each in root.all("asset") for child in each]
    meter = next((float(child.attributes.get("meter", 1)) for child in asset if child.tag == "unit"), 1.0)
    up = next((child.text.strip() for child in asset if child.tag == "up_axis"), "Y_UP")
    meshes: dict[str, tuple[FloatArray, NDArray[np.intp]]] = {}
    for library in root.all("library_geometries"):
        for geometry in library.all("geometry"):
            for mesh in geometry.all("mesh"):
                meshes["#" + geometry.attributes["id"]] = _geometry(mesh)
    placed = [
        found
        for library in root.all("library_visual_scenes")
        for scene in library.all("visual_scene")
        for node in scene.all("node")
        for found in _node(node, np.eye(4), meshes)
    ]
    places = np.cumsum([0, *(len(vertices) for vertices, _ in placed)])
    vertices = np.concatenate([vertices for vertices, _ in placed] or [np.zeros((0, 3))])
    faces = [triangles + first for (_, triangles), first in zip(placed, places, strict=False)]
    return meter * vertices @ _UP[up].T, np.concatenate(faces or [np.zeros((0, 3), dtype=np.intp)])


def _numbers(element: Element) -> FloatArray:
    return np.array(element.text.split(), dtype=float)


def _node(
    node: Element, above: FloatArray, meshes: dict[str, tuple[FloatArray, NDArray[np.intp]]]
) -> list[tuple[FloatArray, NDArray[np.intp]]]:
    """Return the geometries of a node and of those in it, transformed."""
    here, found = above, []
    for child in node:
        if child.tag in ("matrix", "translate", "scale", "rotate"):
            here = here @ _transformation(child)
        elif child.tag == "instance_geometry" and child.attributes["url"] in meshes:
            vertices, faces = meshes[child.attributes["url"]]
            found.append((vertices @ here[:3, :3].T + here[:3, 3], faces))
        elif child.tag == "node":
            found += _node(child, here, meshes)
    return found


def _transformation(element: Element) -> FloatArray:
    values, out = _numbers(element), np.eye(4)
    if element.tag == "matrix":
        return values.reshape(4, 4)
    if element.tag == "translate":
        out[:3, 3] = values
    elif element.tag == "scale":
        out[:3, :3] = np.diag(values)
    else:
        x, y, z = values[:3] / np.linalg.norm(values[:3])
        cross, angle = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), np.radians(values[3])
        out[:3, :3] = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return out


def _geometry(mesh: Element) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return vertices and triangles of a <mesh>; polygons are fans."""
    positions = {
        "#" + source.attributes["id"]: _numbers(array).reshape(-1, 3)
        for source in mesh.all("source")
        for array in source.all("float_array")
        if int(array.attributes["count"]) % 3 == 0
    }
    names = {
        "#" + each.attributes["id"]: item.attributes["source"]
        for each in mesh.all("vertices")
        for item in each.all("input")
        if item.attributes["semantic"] == "POSITION"
    }
    vertices, faces, first = [], [], 0
    for kind in ("triangles", "polylist", "polygons"):
        for group in mesh.all(kind):
            inputs = group.all("input")
            own = next(item for item in inputs if item.attributes["semantic"] == "VERTEX")
            stride = 1 + max(int(item.attributes["offset"]) for item in inputs)
            parts = [np.array(p.text.split(), dtype=np.intp) for p in group.all("p")]
            numbers = [part[int(own.attributes["offset"]) :: stride] for part in parts]
            corners = _polygons(kind, group, numbers)
            points = positions[names[own.attributes["source"]]]
            faces += [[first + a, first + b, first + c] for p in corners for a, b, c in _fan(p)]
            vertices.append(points)
            first += len(points)
    return np.concatenate(vertices or [np.zeros((0, 3))]), np.array(faces, dtype=np.intp).reshape(-1, 3)


def _polygons(kind: str, group: Element, numbers: list[NDArray[np.intp]]) -> list[list[int]]:
    """Return the vertices of each polygon."""
    if kind == "polygons":
        return [part.tolist() for part in numbers]
    whole = np.concatenate(numbers or [np.zeros(0, dtype=np.intp)])
    if kind == "triangles":
        return [part.tolist() for part in whole.reshape(-1, 3)]
    counts = np.array(group.all("vcount")[0].text.split(), dtype=np.intp)
    return [part.tolist() for part in np.split(whole, np.cumsum(counts)[:-1])]


def _fan(polygon: list[int]) -> list[tuple[int, int, int]]:
    return [(polygon[0], a, b) for a, b in pairwise(polygon[1:])]
