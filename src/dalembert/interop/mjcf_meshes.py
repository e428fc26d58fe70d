"""Meshes of MJCF files: where they are, and the mass and inertia that MuJoCo gives to their surfaces.

MuJoCo has four laws for the mass of a mesh. "exact" and "legacy", the default, add up the tetrahedra of the triangles
and a centre, with and without their signs; "convex" does so for the convex hull; "shell" has the mass in the surface.
The first three agree for convex surfaces. Vertices have single precision there, and so they have here.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError
from ..frozen import frozen
from ..scene.shape_meshes import Triangles
from .mesh_files import read_mesh
from .mjcf_settings import check_attributes
from .robot_description import Inertia, Placement
from .robot_files import Element, FileReader

if TYPE_CHECKING:
    from .mjcf_values import Angles, Defaults

LAWS = ("legacy", "exact", "convex", "shell")
"""Values of inertia= of a mesh."""


@final
@frozen(eq=False)
class MeshAsset:
    """A mesh of a file: its element, where its file is, and what takes its vertices to the axes of a geom.

    As in MuJoCo, refpos= is subtracted first; then refquat= turns back, and scale= multiplies.
    """

    element: Element
    path: Path
    place: Placement


@final
class Meshes:
    """The meshes of a file, by name."""

    def __init__(self, file: FileReader, defaults: Defaults, angles: Angles) -> None:
        self.file = file
        compilers = [element.attributes for element in file.root.all("compiler")]
        folder = next((x[what] for what in ("meshdir", "assetdir") for x in compilers if what in x), "")
        exact = any(x.get("exactmeshinertia", "false") == "true" for x in compilers)
        self._usual = "exact" if exact else "legacy"
        self._assets: dict[str, MeshAsset] = {}
        for asset in (each for assets in file.root.all("asset") for each in assets.all("mesh")):
            mesh = defaults.applied(asset, "main")
            written = mesh.attributes.get("file", "")
            turned = {"quat": mesh.attributes["refquat"]} if "refquat" in mesh.attributes else {}
            back = angles.rotation(file, Element("mesh", turned, mesh.line)).T
            map_ = file.numbers(mesh, "scale", 3, (1.0, 1.0, 1.0))[:, np.newaxis] * back
            place = Placement(map_, -map_ @ file.numbers(mesh, "refpos", 3, (0.0, 0.0, 0.0)))
            path = file.path.parent / folder / written
            self._assets[mesh.attributes.get("name", Path(written).stem)] = MeshAsset(mesh, path, place)

    def find(self, name: str) -> Path | None:
        """Return the file of a mesh, if it is there."""
        asset = self._assets.get(name)
        return asset.path if asset is not None and asset.path.is_file() else None

    def place(self, name: str) -> Placement:
        """Return what takes the vertices of a mesh to the axes of a geom: a matrix, with the scale, and an offset."""
        return self._assets[name].place if name in self._assets else Placement()

    def inertia(self, geom: Element) -> Inertia:
        """Return the inertia of the mesh of a geom for the density 1, on the axes of the geom; faults are recorded."""
        name = geom.attributes.get("mesh", "")
        asset = self._assets.get(name)
        if asset is None:
            self.file.fault(geom, f"mesh={name!r} of <geom> {self.file.named(geom)} is no <mesh> of <asset>")
            return Inertia()
        check_attributes(self.file, asset.element)
        shell = geom.attributes.get("shellinertia", "false") == "true"
        law = "shell" if shell else asset.element.attributes.get("inertia", self._usual)
        if law not in LAWS:
            self.file.fault(asset.element, f"inertia={law!r} of mesh {name!r}: known are {', '.join(LAWS)}")
            return Inertia()
        try:
            surface = self._surface(asset, name)
        except OptionError as reason:
            self.file.fault(geom, f"the mass of a body follows from a mesh: {reason}; or give the body an <inertial>")
            return Inertia()
        found = inertia_of_surface(surface, law)
        if found.mass <= 0.0:
            self.file.fault(
                geom,
                f"the {'area' if law == 'shell' else 'volume'} of mesh {name!r} is {found.mass:g}, by inertia={law!r};"
                " turn its triangles outwards, or give the body an <inertial>",
            )
            return Inertia()
        return found

    def _surface(self, asset: MeshAsset, name: str) -> Triangles:
        """Return the surface of a mesh on the axes of a geom; from a file, or from the numbers of the element."""
        given = asset.element.attributes
        if "vertex" not in given:
            surface = read_mesh(asset.path, name)
            vertices, faces = surface.vertices, surface.faces
        else:
            vertices = np.array(given["vertex"].split(), dtype=float).reshape(-1, 3)
            numbers = np.array(given.get("face", "").split(), dtype=np.intp).reshape(-1, 3)
            faces = numbers if len(numbers) else hull_of(vertices)
        return Triangles(np.float32(vertices).astype(float), faces).placed(asset.place.rotation, asset.place.position)


def hull_of(vertices: FloatArray) -> NDArray[np.intp]:
    """Return the triangles of the convex hull of points, turned outwards."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(vertices)
    a, b, c = (vertices[hull.simplices[:, i]] for i in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces: NDArray[np.intp] = np.where(inwards[:, np.newaxis], hull.simplices[:, ::-1], hull.simplices)
    return faces


def inertia_of_surface(surface: Triangles, law: str) -> Inertia:
    """Return mass, mass centre and inertia for the density one, by one of the `LAWS`."""
    faces = hull_of(surface.vertices) if law == "convex" else surface.faces
    corners = surface.vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    middle = areas @ corners.mean(axis=1) / np.sum(areas)
    if law == "shell":
        return _moments(areas, corners - middle, 12.0, middle)
    shares, local = _tetrahedra(corners - middle, law)
    centre = middle + shares @ local.sum(axis=1) / 4.0 / np.sum(shares)
    return _moments(*_tetrahedra(corners - centre, law), 20.0, centre)


def _tetrahedra(corners: FloatArray, law: str) -> tuple[FloatArray, FloatArray]:
    """Return the volumes of the tetrahedra of triangles (n, 3, 3) and the origin, and the triangles."""
    volumes = np.linalg.det(corners) / 6.0
    return np.abs(volumes) if law == "legacy" else volumes, corners


def _moments(shares: FloatArray, corners: FloatArray, divisor: float, centre: FloatArray) -> Inertia:
    """Return the inertia about a centre of simplices with the origin there, by second moments of their corners."""
    sums = corners.sum(axis=1)
    second = np.einsum("n,ni,nj->ij", shares, sums, sums) + np.einsum("n,nki,nkj->ij", shares, corners, corners)
    second /= divisor
    return Inertia(float(np.sum(shares)), centre, np.trace(second) * np.eye(3) - second)
