"""Side views against places computed from the file's numbers, and shapes known by hand."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from armdesign import Machine, load
from armdesign.drawing.outlines import _covered, bodies
from armdesign.drawing.plane import PicturePlane, placed
from armdesign.drawing.side_view import SideView, side_view
from armdesign.drawing.visuals import visuals
from armdesign.errors import PoseError
from armdesign.machine import template
from armdesign.units import mm
from tests.machines import BOOM, LIFT, ODD, CylinderSpec, Joint, build, middle, named
from tests.slewing_tables import MOTOR
from tests.sprung import spring

PLANAR = ["excavator_20t", "loader_crane", "patu_boom", "paper_1dof", "four_bar_right"]


def view_of(name: str) -> tuple[Machine, SideView]:
    machine = named(name)
    return machine, side_view(machine, middle(machine))


@pytest.mark.parametrize("name", PLANAR)
def test_points_are_the_pins_of_the_file(name: str) -> None:
    """x and z of every pin in the world, by the arm's own kinematics and by the placements."""
    machine, view = view_of(name)
    poses = machine.arm.kinematics(middle(machine)[None])
    plane = PicturePlane(machine.heading)
    for pin, at in zip(view.pins, view.points[0], strict=True):
        if pin.link is None or pin.at is None or pin.body is None:
            continue
        world = machine.arm.point(poses, pin.link, np.array(pin.at))[0]
        assert at == pytest.approx(world[[0, 2]], abs=1e-12)
        own = plane.placements(poses, pin.link)[0]
        flat = placed(own, (np.array(pin.at) @ plane.plate(pin.link).T)[None])[0]
        assert flat == pytest.approx(at, abs=1e-12)


@pytest.mark.parametrize("name", PLANAR)
def test_cylinders_are_between_their_pins(name: str) -> None:
    """The distance of the drawn ends is the pin-to-pin length, and rods reach their pins."""
    machine, view = view_of(name)
    lengths = machine.at(middle(machine)).lengths[0]
    for i, (shape, (barrel, rod)) in enumerate(
        zip(view.cylinders, view.barrel_and_rod(), strict=True)
    ):
        base, end = view.points[0, list(shape.ends)]
        assert np.hypot(*(end - base)) == pytest.approx(lengths[i], rel=1e-9)
        assert rod[[1, 2]].mean(axis=0) == pytest.approx(end)
        assert rod[[0, 3]].mean(axis=0) == pytest.approx(base)
        assert np.hypot(*(rod[0] - rod[3])) == pytest.approx(machine.cylinders[i].rod)
        stop = barrel[[1, 2]].mean(axis=0)
        assert np.hypot(*(stop - base)) <= machine.cylinders[i].closed_length + 1e-9
        assert np.hypot(*(barrel[0] - barrel[3])) > machine.cylinders[i].bore
    assert not view.out_of_stroke.any()
    assert view.stray_pins == ()


def test_bars_have_their_lengths() -> None:
    """Rocker and coupler of the 20 t machine: 578.7 and 561.0 mm in its file."""
    _, view = view_of("excavator_20t")
    spans = {bar.name: np.diff(view.points[0, list(bar.ends)], axis=0)[0] for bar in view.bars}
    assert {name: float(np.hypot(*span)) for name, span in spans.items()} == pytest.approx(
        {"bucket.rocker": 0.5787, "bucket.coupler": 0.5610}
    )
    assert "bucket.knee" in {pin.name for pin in view.pins}


def test_outlines_are_what_the_visuals_cover() -> None:
    """The lever of the paper: a crank and an arm, each a box, and a ball, r = 0.183 m."""
    _, view = view_of("paper_1dof")
    body = view.bodies[1]
    assert (body.link, body.source) == ("boom", "visuals")
    (outline,) = body.polygons
    ball = shapely.Point(1.0, 0.15).buffer(0.183, quad_segs=64)
    boxes = [shapely.box(-0.025, 0.0, 0.025, 0.15), shapely.box(0.0, 0.125, 1.0, 0.175)]
    discs = [shapely.Point(0, z).buffer(0.035, quad_segs=64) for z in (0.0, 0.15)]
    expected = shapely.union_all([ball, *boxes, *discs])
    assert shapely.Polygon(outline).symmetric_difference(expected).area < 0.01 * expected.area
    assert view.ground == pytest.approx(-1.04)  # its foot plate is 40 mm thick about −1.02 m


def test_without_visuals_outlines_are_those_of_the_file_else_hulls_of_pins() -> None:
    machine = load("excavator_20t")
    bare = machine.urdf_text.replace("<visual>", "<ignored>").replace("</visual>", "</ignored>")
    machine = Machine.from_text(machine.text, bare, machine.source)
    view = side_view(machine, middle(machine))
    assert {body.source for body in view.bodies} == {"outline"}
    stick = next(body for body in view.bodies if body.link == "stick")
    assert [-1.022, 0.26] in np.round(stick.polygons[0], 6).tolist()  # its first corner
    odd = named("crossing")
    for body in side_view(odd, middle(odd)).bodies:
        assert body.source == "pins"
        assert len(body.polygons) == 1


def test_a_mesh_is_drawn_and_a_missing_one_is_not(tmp_path: Path) -> None:
    """A triangle of 2 m × 1 m / 2, scaled from millimetres; the other link keeps its hull."""
    corners = ("0 0 0", "2000 0 0", "0 0 1000")
    loops = "".join(f"vertex {corner}\n" for corner in corners)
    text = f"solid a\nfacet normal 0 -1 0\nouter loop\n{loops}endloop\nendfacet\nendsolid a\n"
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "boom.stl").write_text(text)
    machine = named("crossing")
    urdf = machine.urdf_text
    for link, file in (("boom", "boom.stl"), ("stick", "no.stl")):
        mesh = f'<mesh filename="package://odd/meshes/{file}" scale="0.001 0.001 0.001"/>'
        visual = f"<visual><geometry>{mesh}</geometry></visual>"
        urdf = urdf.replace(f'<link name="{link}">', f'<link name="{link}">{visual}')
    machine = Machine.from_text(machine.text, urdf, tmp_path / "odd.toml")
    shapes = {b.link: b for b in bodies(machine)}
    assert shapely.Polygon(shapes["boom"].polygons[0]).area == pytest.approx(1.0)
    assert shapes["stick"].source == "pins"


def test_a_mirrored_pin_is_seen() -> None:
    """z of the boom cylinder's rod pin with the wrong sign: outside the boom."""
    machine = load("excavator_20t")
    q = middle(machine)
    text = machine.text.replace("[2233.7, 0, 950.5]", "[2233.7, 0, -950.5]")
    view = side_view(Machine.unchecked(text, machine.urdf_text, machine.source), q)
    assert view.stray_pins == ("boom.rod_end",)
    assert len(view.arcs) == 3


def test_a_cylinder_out_of_its_stroke_is_seen() -> None:
    """Half a degree beyond either end of the paper's joint."""
    machine = named("paper_1dof")
    (low, high), beyond = machine.ranges[0], math.radians(0.5)
    view = side_view(machine, [[low - beyond], [low], [high], [high + beyond]])
    assert view.out_of_stroke[:, 0].tolist() == [True, False, False, True]


def test_a_machine_whose_pressure_is_in_another_unit_is_drawn() -> None:
    """210 bar in psi: no steel barrel carries so much, and `check` ended in that after all."""
    machine = named("mini_excavator_2t").replace({"supply.pressure_bar": 3045.0})
    for shape in side_view(machine, middle(machine)).cylinders:
        assert shape.rod_width < shape.barrel_width < 1


@pytest.mark.parametrize("name", [*ODD, "slewing", "rocking"])
def test_every_machine_can_be_drawn(name: str) -> None:
    """Skew, branched, slewing, redundant machines, motors and springs: finite, repeatable."""
    machine, view = view_of(name)
    assert np.isfinite(view.placements).all()
    assert np.isfinite(view.points).all()
    assert view.size > 0
    assert len(view.cylinders) == len(machine.cylinders)
    record = json.loads(json.dumps(view.record()))
    for body, matrix, drawn in zip(
        record["bodies"], record["placements"][0], view.polygons(), strict=True
    ):
        for polygon, corners in zip(body["polygons"], drawn, strict=True):
            again = placed(np.array(matrix), np.array(polygon))
            assert again == pytest.approx(corners, abs=3e-4)


def test_the_observer_turns_with_the_arm() -> None:
    """Slewing moves nothing in the picture."""
    machine = named("slewing")
    q = np.tile(middle(machine), (2, 1))
    (slew,) = machine.arm.slewing
    q[1, slew] += 1.0
    view = side_view(machine, q)
    assert view.points[1] == pytest.approx(view.points[0])
    assert view.placements[1] == pytest.approx(view.placements[0])
    assert machine.joints[slew] not in {arc.joint for arc in view.arcs}


def _rocked(tilt: float) -> Machine:
    """A boom on a column that slews 0.5 m above a carriage on a spring, tilted about y."""
    rock = Joint("rock", "root", xyz=(0, 0, 0.4), limits=(-0.1, 0.1))
    column = Joint("column", "rock", xyz=(0, 0, 0.5), axis=(0, 0, 1), limits=(-3, 3))
    lift = CylinderSpec("lift", ("column", (0.7, 0, 0.1)), LIFT.rod_end)
    more = MOTOR + spring("carriage", "rock", 9e6, f"at_deg = {math.degrees(tilt)}")
    joints = [rock, column, replace(BOOM, parent="column")]
    tool = "boom", (1.0, 0.0, -0.2)
    return build(joints, [lift], order=["column", "boom"], payload=tool, more=more)


@pytest.mark.parametrize("slew", [-math.pi / 2, 0.0, math.pi / 2])
def test_the_observer_turns_with_an_arm_that_rocks(slew: float) -> None:
    """Slewed aside, an arm is not seen from its end: reach as it is, height as it stands there.

    In the frame of the column the plane of the arm is x and z. Turned aside by a right angle, the
    carriage's tilt about y, 0.4 m above the ground, shifts the foot of the slew axis ahead, and
    foreshortens heights above it by its cosine.
    """
    tilt, lifted = 0.03, 0.4
    machine = _rocked(tilt)
    view = side_view(machine, [slew, lifted])
    along = 0.1 + math.cos(lifted) + 0.2 * math.sin(lifted)
    above = 0.5 + 0.5 + math.sin(lifted) - 0.2 * math.cos(lifted)
    if slew == 0:  # tilted in the picture
        place = (
            along * math.cos(tilt) - above * math.sin(tilt),
            0.4 + along * math.sin(tilt) + above * math.cos(tilt),
        )
    else:
        place = along + 0.4 * math.tan(tilt), 0.4 + above * math.cos(tilt)
    assert view.tool[0] == pytest.approx(place, abs=1e-9)
    base, end = view.points[0]
    assert np.hypot(*(end - base)) == pytest.approx(view.lengths[0, 0], rel=tilt**2)
    assert {arc.joint for arc in view.arcs} == {"boom"}


def test_arcs_end_where_the_joints_do() -> None:
    """The arc of the paper's joint, about the origin: its angle is the range."""
    machine, view = view_of("paper_1dof")
    ((arc, line),) = zip(view.arcs, view.arc_lines(), strict=True)
    angles = np.arctan2(line[:, 1], line[:, 0])
    assert angles[-1] - angles[0] == pytest.approx(np.ptp(machine.ranges))
    assert (arc.lower, arc.upper) == pytest.approx(tuple(machine.ranges[0]))
    assert np.hypot(*line.T) == pytest.approx(np.full(len(line), np.hypot(*line[0])))


def test_a_pose_of_another_shape_is_refused() -> None:
    with pytest.raises(PoseError, match="has shape"):
        side_view(named("paper_1dof"), [0.1, 0.2])
    with pytest.raises(PoseError, match="not finite"):
        side_view(named("paper_1dof"), [math.nan])


def test_a_link_of_links_is_drawn_to_its_end(tmp_path: Path) -> None:
    """A telescope's boom ends where no joint is: it stopped at the last pin that it carries."""
    path = tmp_path / "loader.toml"
    path.write_text(template.new("loader", links=2), encoding="utf-8")
    machine = load(path)
    last = f"links.{machine.joints[-1]}.length_mm"
    tool = machine.tool.at[0]

    def end(length: float) -> float:
        (outline,) = bodies(machine.replace({last: length / mm}))[-1].polygons
        return float(outline[:, 0].max())

    assert end(0.9 * tool) == end(tool)
    assert end(3 * tool) > 3 * tool


def _torus(many: int) -> np.ndarray:
    """Triangles (2 m², 3, 2) of a torus, closed, seen from where its hole shows."""
    turn = np.linspace(0, 2 * np.pi, many + 1)
    around, along = np.meshgrid(turn, turn, indexing="ij")
    radius = 0.5 + 0.2 * np.cos(along)
    places = np.stack([radius * np.cos(around), 0.9 * radius * np.sin(around)], axis=-1)
    corners = places[:-1, :-1], places[1:, :-1], places[1:, 1:], places[:-1, 1:]
    halves = [np.stack([corners[0], *corners[k : k + 2]], axis=2) for k in (1, 2)]
    return np.concatenate([half.reshape(-1, 3, 2) for half in halves])


@pytest.mark.parametrize("kind", ["closed", "open", "heap"])
def test_meshes_of_many_triangles_cover_what_their_union_does(kind: str) -> None:
    rng = np.random.default_rng(3)
    triangles = _torus(30)
    if kind == "open":
        triangles = triangles[rng.random(len(triangles)) < 0.7]
    if kind == "heap":
        triangles = rng.uniform(-1, 1, (300, 1, 2)) + rng.uniform(-0.1, 0.1, (300, 3, 2))
    union = shapely.union_all(shapely.polygons(triangles), grid_size=1e-5)
    shape = _covered(triangles)
    assert shape.symmetric_difference(union).area < 1e-4 * union.area
    assert shape.area == pytest.approx(union.area, rel=1e-4)


def test_a_heap_of_edges_is_drawn_by_its_hull(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("armdesign.drawing.outlines.MOST_EDGES", 20)
    triangles = np.random.default_rng(3).uniform(-1, 1, (50, 3, 2))
    assert _covered(triangles).equals(shapely.convex_hull(_covered(triangles)))


@pytest.mark.parametrize("turn", ["0", "0 0 0 0", "inf 0 0", "nan 0 0", "1e300 0 0"])
def test_a_visual_whose_place_cannot_be_read_is_left_out(turn: str, tmp_path: Path) -> None:
    shape = '<geometry><box size="1 1 1"/></geometry>'
    urdf = f'''<robot name="r"><link name="a"><visual><origin rpy="{turn}"/>{shape}</visual>
        <visual>{shape}</visual><visual><geometry><box size="1e300 1 1"/></geometry></visual>
        </link></robot>'''
    assert len(visuals(urdf, tmp_path)["a"]) == 1


@pytest.mark.parametrize(
    ("rgba", "colour"), [("1 nan 0 1", None), ("1 0 0", None), ("2 0.5 0 1", (1.0, 0.5, 0.0, 1.0))]
)
def test_colours_of_a_urdf(rgba: str, colour: object, tmp_path: Path) -> None:
    urdf = f'''<robot name="r"><material name="m"><color rgba="{rgba}"/></material>
        <link name="a"><visual><geometry><sphere radius="1"/></geometry><material name="m"/>
        </visual></link></robot>'''
    assert visuals(urdf, tmp_path)["a"][0].colour == colour


@pytest.mark.parametrize("turn", [-0.6, 0.0, 0.5])
def test_a_cylinder_across_a_slew_is_as_long_as_it_is(turn: float) -> None:
    """By the law of cosines; slewing is not drawn, but lengthens and shortens it."""
    column = Joint("column", "root", xyz=(0, 0, 0.5), axis=(0, 0, 1), limits=(-0.8, 0.8))
    swing = CylinderSpec("swing", ("root", (-0.9, 0.5, 0.5)), ("column", (0.0, 0.6, 0.0)))
    boom, lift = replace(BOOM, parent="column"), replace(LIFT, base=("column", (0.7, 0, 0.1)))
    machine = build([column, boom], [swing, lift])
    near, far, apart = math.hypot(0.9, 0.5), 0.6, math.pi / 2 - math.atan2(0.5, -0.9) + turn
    length = math.sqrt(near**2 + far**2 - 2 * near * far * math.cos(apart))
    assert side_view(machine, [turn, 0.1]).lengths[0, 0] == pytest.approx(length, rel=1e-12)
