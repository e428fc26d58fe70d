"""Shapes of MJCF files for pictures: geoms that simulators show, and the files of their meshes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..arrays import FloatArray
from .mjcf_values import PRIMITIVES, Angles, Defaults, primitive_of
from .robot_description import Placement
from .robot_files import Element, FileReader
from .robot_visuals import Visual, color_of

_SHOWN = 2
"""Last group of geoms that is shown; the others are for collisions."""

_WIDE = 4.0
"""Edge of a plane without end [m]."""


def visual_of(file: FileReader, geom: Element, angles: Angles, around: Placement) -> Visual | None:
    """Return the shape of a geom with its defaults applied, on the axes of a link; None for one that is not shown."""
    kind = geom.attributes.get("type", "mesh" if "mesh" in geom.attributes else "sphere")
    if file.number(geom, "group", 0.0) > _SHOWN:
        return None
    color = color_of(file.numbers(geom, "rgba", 4, None).tolist()) if "rgba" in geom.attributes else None
    if kind in PRIMITIVES and "mesh" not in geom.attributes:
        size, place = primitive_of(file, geom, angles)
        if not size:
            return None
        numbers = np.array(size[: PRIMITIVES[kind]])
        numbers[{"box": 0, "cylinder": 1, "capsule": 1}.get(kind, 3) :] *= 2.0  # files have half edges
        return Visual(around.then(place), kind, numbers, color=color)
    place = around.then(angles.placement(file, geom))
    if kind == "plane":
        half = [float(word) for word in geom.attributes.get("size", "0 0").split()[:2]]
        edges = [2.0 * each if each > 0.0 else _WIDE for each in half]
        return Visual(place, "box", np.array([*edges, 1e-6 * max(edges)]), color=color)
    return Visual(place, "mesh", np.ones(3), geom.attributes.get("mesh", f"a geom of type {kind}"), color)


def mesh_assets(file: FileReader, defaults: Defaults) -> tuple[Callable[[str], Path | None], dict[str, FloatArray]]:
    """Return what finds the file of a mesh by its name, and the scales (3,) of meshes by their names."""
    compilers = [element.attributes for element in file.root.all("compiler")]
    folder = next((x[what] for what in ("meshdir", "assetdir") for x in compilers if what in x), "")
    files: dict[str, Path] = {}
    scales: dict[str, FloatArray] = {}
    for asset in (each for assets in file.root.all("asset") for each in assets.all("mesh")):
        mesh = defaults.applied(asset, "main")
        written = mesh.attributes.get("file", "")
        name = mesh.attributes.get("name", Path(written).stem)
        files[name] = file.path.parent / folder / written
        scales[name] = file.numbers(mesh, "scale", 3, (1.0, 1.0, 1.0))

    def find(name: str) -> Path | None:
        path = files.get(name)
        return path if path is not None and path.is_file() else None

    return find, scales
