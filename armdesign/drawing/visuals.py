"""Visuals of a URDF: boxes, cylinders, spheres and meshes of each link, for pictures alone."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.urdf import origin
from armdesign.mechanism.urdf_faults import LARGEST, numbers

SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}
COUNTS = {"box": 3, "cylinder": 2, "sphere": 1}


@dataclass(frozen=True, eq=False, kw_only=True)
class Visual:
    """One visual of a link, placed in the link's frame.

    Attributes:
        kind: box, cylinder, sphere or mesh.
        size: edges of a box, radius and length of a cylinder along z, radius of a sphere, scale
            of a mesh along its three axes [m].
        rotation: of its own frame (3, 3).
        translation: of its own frame [m].
        mesh: its file; None where it is no mesh, or its file is not there.
        colour: red, green, blue, opacity from 0 to 1; None where the URDF says none.
    """

    kind: str
    size: Array
    rotation: Array
    translation: Array
    mesh: Path | None = None
    colour: tuple[float, ...] | None = None

    def placed(self, points: Array) -> Array:
        """Points (…, 3) of its own frame in the link's frame."""
        return np.asarray(points @ self.rotation.T + self.translation)


def visuals(urdf_text: str, folder: Path) -> dict[str, tuple[Visual, ...]]:
    """Visuals of every link of a URDF; what cannot be read is left out.

    Args:
        urdf_text: the URDF.
        folder: of the URDF, where meshes are looked for.
    """
    robot = ET.fromstring(urdf_text)
    colours = dict(_named_colours(robot))
    return {
        str(link.get("name")): tuple(
            visual
            for element in link.findall("visual")
            if (visual := _visual(element, folder, colours)) is not None
        )
        for link in robot.findall("link")
    }


def _named_colours(robot: ET.Element) -> Iterator[tuple[str, tuple[float, ...]]]:
    for material in robot.iter("material"):
        if (colour := material.find("color")) is not None:
            rgba = numbers(colour, "rgba", "")
            if rgba.shape == (4,) and np.isfinite(rgba).all():
                yield material.get("name", ""), tuple(rgba.clip(0.0, 1.0).tolist())


def _visual(
    element: ET.Element, folder: Path, colours: dict[str, tuple[float, ...]]
) -> Visual | None:
    """A visual; None where its shape or place cannot be read."""
    shape = element.find("geometry/*")
    if shape is None:
        return None
    size = np.concatenate(
        [np.zeros(0), *(numbers(shape, key, "") for key in SIZES.get(shape.tag, ()))]
    )
    mesh = None
    if shape.tag == "mesh":
        size, mesh = numbers(shape, "scale", "1 1 1"), mesh_file(shape.get("filename", ""), folder)
    turned, moved = (numbers(element.find("origin"), key, "0 0 0") for key in ("rpy", "xyz"))
    counts = [len(given) for given in (size, turned, moved)]
    if counts != [COUNTS.get(shape.tag, 3), 3, 3]:
        return None
    if not (np.abs(np.concatenate([size, turned, moved])) <= LARGEST).all():
        return None
    rotation, translation = origin(element)
    if shape.tag not in SIZES and mesh is None:
        return None
    material = element.find("material")
    colour = None if material is None else colours.get(material.get("name", ""))
    return Visual(
        kind=shape.tag,
        size=size,
        rotation=rotation,
        translation=translation,
        mesh=mesh,
        colour=colour,
    )


def mesh_file(name: str, folder: Path) -> Path | None:
    """File of a mesh, from beside the URDF or the folders above it; None without one.

    Of ``package://<package>/<path>`` the path counts with the package's name and without.
    """
    words = name.removeprefix("file://").removeprefix("package://")
    inside = words.partition("/")[2] if name.startswith("package://") else words
    for above in (folder, *folder.parents[:3]):
        for path in (words, inside):
            if path and (above / path).is_file():
                return above / path
    return None


def convex_pieces(visual: Visual) -> Array:
    """Corners (n, m, 3) [m] of n convex pieces of a visual, in the link's frame.

    The corners of a box, both rims of a cylinder, points all over a sphere; the triangles of a
    mesh, none of a mesh that cannot be read.
    """
    if visual.kind == "box":
        signs = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
        pieces = (signs * visual.size)[None]
    elif visual.kind == "cylinder":
        pieces = _rims(*visual.size.tolist())[None]
    elif visual.kind == "sphere":
        pieces = (_directions() * visual.size[0])[None]
    else:
        pieces = _triangles(visual)
    return visual.placed(pieces)


def _rims(radius: float, length: float) -> Array:
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)
    return np.concatenate([rim + side * length / 2 * np.eye(3)[2] for side in (-1, 1)])


def _directions() -> Array:
    """Points all over the unit sphere, among them great circles square to each axis."""
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    height = np.sin(np.linspace(-np.pi / 2, np.pi / 2, 25))[:, None]
    ring = np.sqrt(1 - height**2)
    x, y, z = np.broadcast_arrays(ring * np.cos(angle), ring * np.sin(angle), height)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def _triangles(visual: Visual) -> Array:
    """Triangles (n, 3, 3) of a mesh, scaled; coal is Pinocchio's library of shapes."""
    import coal

    try:
        mesh = coal.MeshLoader().load(str(visual.mesh), visual.size)
    except ValueError:
        return np.zeros((0, 3, 3))
    corners = np.array(mesh.vertices()).reshape(-1, 3)
    faces = [mesh.tri_indices(i) for i in range(mesh.num_tris)]
    return corners[np.array([[face[k] for k in range(3)] for face in faces])]
