"""Scenes against the machine's own kinematics, and meshes against volumes known by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from armdesign.drawing.side_view import shown_cylinders, side_view
from armdesign.drawing.visuals import Visual
from armdesign.viewing.meshes import Mesh, of_visual, plate, tube
from armdesign.viewing.scene import Scene, scene_of
from tests.machines import CylinderSpec, Joint, build, inner_poses, named

MACHINES = [
    *("excavator_20t", "loader_crane", "patu_boom", "paper_1dof"),
    *("four_bar_right", "spatial", "redundant", "rotator", "slewing", "rocking"),
]


@cache
def scene_named(name: str) -> Scene:
    return scene_of(named(name))


def placed(scene: Scene, q: np.ndarray, frame: str, at: tuple[float, ...]) -> np.ndarray:
    """Places (n, 3) of a point of a frame."""
    turn, origin = scene.placements(q)[frame]
    return np.asarray(turn @ np.array(at) + origin)


def volume(mesh: Mesh) -> float:
    """Volume within a closed surface whose triangles look outwards (divergence theorem)."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return float(np.einsum("ti,ti->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize("name", MACHINES)
def test_cylinders_are_as_long_as_the_machine_says(name: str) -> None:
    machine, scene = named(name), scene_named(name)
    q = inner_poses(machine, 5)
    lengths = machine.at(q).lengths
    for i, cylinder in enumerate(machine.cylinders):
        base = placed(scene, q, f"{cylinder.name}.barrel", (0.0, 0.0, 0.0))
        end = placed(scene, q, f"{cylinder.name}.rod", (0.0, 0.0, 0.0))
        np.testing.assert_allclose(np.linalg.norm(end - base, axis=1), lengths[:, i], rtol=1e-9)
        ahead = placed(scene, q, f"{cylinder.name}.barrel", (1.0, 0.0, 0.0)) - base
        np.testing.assert_allclose(ahead * lengths[:, [i]], end - base, atol=1e-9)


@pytest.mark.parametrize("name", MACHINES)
def test_pins_are_where_the_links_carry_them(name: str) -> None:
    """Marks by the frames of the scene, against the arm's own points; bars end at the knee."""
    machine, scene = named(name), scene_named(name)
    q = inner_poses(machine, 5)
    poses = machine.arm.kinematics(q)
    marks = {mark.name: placed(scene, q, mark.frame, mark.at) for mark in scene.marks}
    np.testing.assert_allclose(marks["tool"], machine.at(q).tool, atol=1e-9)
    for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
        ends = dict(zip(("base", linkage.rod_end_name), linkage.ends(poses), strict=True))
        for key, places in ends.items():
            np.testing.assert_allclose(marks[f"{cylinder.name}.{key}"], places, atol=1e-9)
        for bar, pin in linkage.legs:
            (length,) = linkage.place(bar) or (0.0,)
            frame = f"{cylinder.name}.{bar}"
            begin, knee = (placed(scene, q, frame, (x, 0.0, 0.0)) for x in (0.0, length))
            np.testing.assert_allclose(begin, marks[f"{cylinder.name}.{pin}"], atol=1e-9)
            # bars move in a plane: a lug beside it is a little farther than they are long
            np.testing.assert_allclose(knee, ends[linkage.rod_end_name], atol=1e-3)


@pytest.mark.parametrize("name", MACHINES)
def test_every_solid_is_carried_and_closed(name: str) -> None:
    machine, scene = named(name), scene_named(name)
    frames = scene.placements(inner_poses(machine, 1))
    assert {solid.frame for solid in scene.solids} <= set(frames)
    assert len({solid.name for solid in scene.solids}) == len(scene.solids)
    shapes = side_view(machine, machine.ranges.mean(axis=1)).cylinders
    for (cylinder, _, _), shape in zip(shown_cylinders(machine), shapes, strict=True):
        barrel = next(one for one in scene.solids if one.name == f"{cylinder.name}.barrel")
        long = shape.barrel[1] - shape.barrel[0]
        area = 24 / 2 * math.sin(2 * math.pi / 24)  # of a 24-gon in the unit circle
        tubes = (shape.barrel_width**2 * long + shape.rod_width**2 * shape.barrel[0]) / 4
        assert volume(barrel.mesh) == pytest.approx(shape.count * area * tubes, rel=1e-9)
    for turn, _ in frames.values():
        np.testing.assert_allclose(turn @ np.swapaxes(turn, 1, 2), np.eye(3)[None], atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(turn), 1.0)


def test_a_four_bar_that_does_not_close_has_no_place() -> None:
    """Of the 20 t machine with a rocker that is too short for most of the bucket's poses."""
    machine = named("excavator_20t")
    linkages = [*machine.linkages[:2], machine.linkages[2].with_places({"rocker": (0.3,)})]
    machine = replace(machine, linkages=tuple(linkages))
    scene, rng = scene_of(machine), np.random.default_rng(1)
    q = rng.uniform(-np.pi, np.pi, (200, len(machine.joints)))
    open_ = ~np.isfinite(machine.margins(q)).all(axis=1)
    assert 0 < open_.sum() < len(q)
    name = next(n for n in scene.placements(q) if n.endswith(".rocker"))
    assert (np.isfinite(scene.placements(q)[name][0]).all(axis=(1, 2)) == ~open_).all()


def test_a_ram_across_the_machine_has_its_place() -> None:
    """Beside a slewing column, along y at 0 rad, where nothing else tells how it is turned."""
    column = Joint("swing", "root", axis=(0, 0, 1), limits=(-0.8, 0.8))
    ram = CylinderSpec("ram", ("root", (0.3, -1.0, 0.0)), ("swing", (0.3, 0.0, 0.0)))
    frames = scene_of(build([column], [ram])).placements(np.array([[0.0], [0.3]]))
    for rotation in (frames["ram.barrel"][0], frames["ram.rod"][0]):
        square = rotation @ np.swapaxes(rotation, 1, 2)
        assert square == pytest.approx(np.tile(np.eye(3), (2, 1, 1)))
        assert rotation[0, :, 0] == pytest.approx([0.0, 1.0, 0.0])


def test_meshes_have_the_volumes_of_their_shapes() -> None:
    """A tube of 24 sides, an L of area 3 that is 0.5 thick whichever way it runs, box, ball."""
    pipe = tube(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 5.0]), 0.5)
    polygon = 24 / 2 * math.sin(2 * math.pi / 24)
    assert volume(pipe) == pytest.approx(polygon * 0.25 * 2, rel=1e-12)
    corners = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], dtype=float)
    axes = np.eye(3)[[0, 2]]
    for outline in (corners, corners[::-1]):
        solid = plate(outline, axes, np.array([0.0, 7.0, 0.0]), 0.5)
        assert volume(solid) == pytest.approx(3 * 0.5, rel=1e-12)
        assert np.ptp(solid.vertices, axis=0) == pytest.approx([2, 0.5, 2])
    turn, at = np.eye(3), np.array([1.0, 0.0, 0.0])
    box = Visual(kind="box", size=np.array([1.0, 2.0, 3.0]), rotation=turn, translation=at)
    assert volume(of_visual(box)) == pytest.approx(6)
    ball = Visual(kind="sphere", size=np.array([1.0]), rotation=turn, translation=at)
    assert volume(of_visual(ball)) == pytest.approx(4 / 3 * math.pi, rel=0.02)
