"""The drawn scene of a report: machines in the worst pose of every cell of their maps.

The maps are of frequency or of bandwidth. A cell is a rectangle of two joints, under one load case
or all. Its worst pose is kept with what draws the machine there: matrices that place its bodies,
places of the pins that no body carries, joints, and how far these go in each of the lowest modes.
Numbers are packed: places are finer than 1 mm, joints and frequencies rounded as they are printed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array, percentiles
from armdesign.drawing.colours import SPRING, actuator_colours
from armdesign.drawing.side_view import SideView, side_view
from armdesign.drawing.swing import PictureJoints, Swing, Swings, picture_joints
from armdesign.frequency.cases import groups_by_case
from armdesign.frequency.joint_grid import cell_edges, nearest
from armdesign.frequency.modes import energy_shares, natural_modes
from armdesign.report.packed import Packed, packed, rounded, whole
from armdesign.units import WORKSHOP, Units

if TYPE_CHECKING:
    from armdesign.control.bandwidth_map import BandwidthMap
    from armdesign.frequency.maps import FrequencyMap
    from armdesign.frequency.workspace import Workspace
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.urdf import Joint

CELLS = 2400  # of all planes, load cases and machines: finer grids share cells, for a small page
MODES = 3  # the lowest, in which a machine can swing
PLANES = 6  # pairs of joints
PERCENTS = (5.0, 50.0)
FREQUENCY = "lowest coupled natural frequency [Hz]"
BANDWIDTH = "bandwidth of the narrowest loop [Hz]"
SCHEMES = ("own", "damped", "proportional")  # of control, the first one on the map
DECIMALS = 3  # of frequencies [Hz], as in every table
IN_PLATE = 1e-3  # [m] by which a pin may leave the plate of its body


@dataclass(frozen=True, kw_only=True)
class CellAxis:
    """A joint along which cells lie: its name and unit, positions of cells and edges between."""

    name: str
    unit: str
    middles: tuple[float, ...]
    edges: tuple[float, ...]

    def __post_init__(self) -> None:
        """Have a cell.

        Raises:
            ValueError: there is none.
        """
        if not self.middles:
            raise ValueError("an axis without cells")


@dataclass(frozen=True, kw_only=True)
class CellPlane:
    """Cells of two joints; of one where ``y`` is None."""

    x: CellAxis
    y: CellAxis | None


@dataclass(frozen=True, kw_only=True)
class DrawnMachine:
    """A machine with its cells and their worst poses; the first pose is the worst of all.

    Attributes:
        label: of the machine.
        parts: names of what can limit: actuators and springs.
        cells: columns plane, load case (0: all), cell (y fastest), pose.
        frequencies: of each cell [Hz]: lowest, then percentiles ``PERCENTS``.
        poses: columns load case (from 1), then the limiting part of each mode.
        positions: of each pose, as printed: joints in their axes' units, then the frequency of
            each mode [Hz].
        standing: matrix (2, 3) of the first body, which never moves, row by row.
        placements: of each pose: matrices of the other bodies, then places of loose points.
        joints: what moves each body but the first: body that carries it, whether it is a hinge.
        pivots: of each pose: places of hinges, directions of slides.
        swings: of each pose and of each of the lowest ``MODES`` modes, one way: how far the joints
            go, angles of hinges to the left in the picture, and the tool [m].
        bodies: outlines (m, 2) [m] of each body in its plate.
        points: names, body and place of all pins and of the tool; loose ones have no place in
            their body, knees no body.
        cylinders: as in ``SideView``, with the colour of each.
        bars: as in ``SideView``.
        ground: height [m].
        loops: of each pose, on a map of bandwidth: of the ``SCHEMES`` [Hz], and the joint whose
            loop is the narrowest; None on a map of frequency.
    """

    label: str
    parts: tuple[str, ...]
    cells: Packed
    frequencies: Packed
    poses: Packed
    positions: Packed
    standing: tuple[float, ...]
    placements: Packed
    joints: tuple[tuple[int, bool], ...]
    pivots: Packed
    swings: Packed
    bodies: tuple[tuple[tuple[tuple[float, float], ...], ...], ...]
    points: tuple[dict[str, Any], ...]
    cylinders: tuple[dict[str, Any], ...]
    bars: tuple[dict[str, Any], ...]
    ground: float
    loops: Packed | None = None


@dataclass(frozen=True, kw_only=True)
class MapScene:
    """Machines of one arm with their maps on the same cells, and what the maps show.

    ``joints`` are names, units and decimals; ``length`` is the factor of lengths from metres,
    their unit and the decimals of ways.
    """

    planes: tuple[CellPlane, ...]
    joints: tuple[tuple[str, str, int], ...]
    length: tuple[float, str, int]
    cases: tuple[str, ...]
    machines: tuple[DrawnMachine, ...]
    quantity: str = FREQUENCY

    def __post_init__(self) -> None:
        """Have a plane, and values of a known quantity.

        Raises:
            ValueError: there is none, or another quantity.
        """
        if not self.planes or self.quantity not in (FREQUENCY, BANDWIDTH):
            raise ValueError("a scene without cells, or of another quantity")


@dataclass(frozen=True, eq=False, kw_only=True)
class _Mapped:
    """A map as a scene knows it.

    Attributes:
        machine: the machine.
        workspace: the poses.
        q: joint positions of each row (n + 1, nq) [rad, m]; first the worst pose, in no cell.
        payload: names of their load cases (n + 1,).
        values: that the colours show (n,) [Hz], without the first row.
        weights: what each counts in percentiles (n,).
        loops: as in ``DrawnMachine``, of each row (n + 1, 4).
    """

    machine: Machine
    workspace: Workspace
    q: Array
    payload: Array
    values: Array
    weights: Array
    loops: Array | None = None


def scene_of(maps: Mapping[str, FrequencyMap], units: Units = WORKSHOP) -> MapScene:
    """The scene of maps on one workspace, by the labels of their machines, today's first."""
    return _scene({label: _of_frequencies(one) for label, one in maps.items()}, FREQUENCY, units)


def bandwidth_scene(maps: Mapping[str, BandwidthMap], units: Units = WORKSHOP) -> MapScene | None:
    """The scene of maps of bandwidth; None for machines that differ in joints or load cases."""
    machines = [one.machine for one in maps.values()]
    kinds = {(one.joints, tuple(case.name for case in one.payloads)) for one in machines}
    if len(kinds) > 1:
        return None
    return _scene({label: _of_bandwidths(one) for label, one in maps.items()}, BANDWIDTH, units)


def _of_frequencies(frequencies: FrequencyMap) -> _Mapped:
    worst = frequencies.worst
    return _Mapped(
        machine=frequencies.machine,
        workspace=frequencies.workspace,
        q=np.concatenate([worst.q[None], frequencies.q]),
        payload=np.concatenate([[worst.payload], frequencies.columns["payload"]]),
        values=frequencies.lowest,
        weights=frequencies.weights,
    )


def _of_bandwidths(bandwidths: BandwidthMap) -> _Mapped:
    """All rows at which a controller works."""
    import pandas as pd

    works = bandwidths.frame[bandwidths.frame["works"]]
    frame = pd.concat([bandwidths.worst(SCHEMES[0]).to_frame().T, works], ignore_index=True)
    each = frame[[f"{SCHEMES[0]}_{joint}_hz" for joint in bandwidths.machine.joints]]
    reached = frame[[f"{scheme}_hz" for scheme in SCHEMES]].to_numpy(dtype=float)
    narrowest = each.to_numpy(dtype=float).argmin(axis=1)
    return _Mapped(
        machine=bandwidths.machine,
        workspace=bandwidths.workspace,
        q=frame[list(bandwidths.machine.joints)].to_numpy(dtype=float),
        payload=frame["payload"].to_numpy(),
        values=reached[1:, 0],
        weights=np.ones(len(works)),
        loops=np.column_stack([reached, narrowest]),
    )


def _scene(maps: Mapping[str, _Mapped], quantity: str, units: Units) -> MapScene:
    first = next(iter(maps.values()))
    joints = first.machine.arm.joints
    moving = [j for j in range(len(joints)) if j not in first.machine.joints_without_effect] or [0]
    pairs = list(combinations(moving, min(len(moving), 2)))[:PLANES]
    share = CELLS / (len(pairs) * len(first.machine.payloads) * len(maps))
    finest = max(int(share ** (1 / len(pairs[0]))), 2)
    grids = {j: _middles([one.workspace.axes[j] for one in maps.values()], finest) for j in moving}
    axes = {j: _axis(joints[j], grids[j], units) for j in moving}
    length, unit, digits = units.table["m"]
    cases = tuple(payload.name for payload in first.machine.payloads)
    planes = [CellPlane(x=axes[p[0]], y=axes[p[1]] if len(p) > 1 else None) for p in pairs]
    return MapScene(
        planes=tuple(planes),
        joints=tuple((joint.name, *units.table[joint.unit][1:]) for joint in joints),
        cases=cases,
        length=(1 / length, unit, digits - 1),
        machines=tuple(
            _drawn_machine(label, one, [{j: grids[j] for j in pair} for pair in pairs], units)
            for label, one in maps.items()
        ),
        quantity=quantity,
    )


def _middles(axes: Sequence[Array], finest: int) -> Array:
    """Middles of at most ``finest`` cells along a joint's axis of several maps."""
    low, high = min(axis[0] for axis in axes), max(axis[-1] for axis in axes)
    return np.linspace(low, high, min(*map(len, axes), finest))


def _axis(joint: Joint, middles: Array, units: Units) -> CellAxis:
    factor, unit, _ = units.table[joint.unit]
    at, edges = ((values / factor).tolist() for values in (middles, cell_edges(middles)))
    return CellAxis(name=joint.name, unit=unit, middles=tuple(at), edges=tuple(edges))


@dataclass(frozen=True, eq=False, kw_only=True)
class _WorstPoses:
    """Cells of a map: plane, load case, cell and row of the worst pose (n, 4), and frequencies."""

    table: Array
    frequencies: Array


def _cells(mapped: _Mapped, planes: list[dict[int, Array]]) -> _WorstPoses:
    q, payload, lowest = mapped.q[1:], mapped.payload[1:], mapped.values
    rows_of = {0: np.arange(len(q))}
    for k, load_case in enumerate(mapped.machine.payloads):
        rows_of[k + 1] = np.flatnonzero(payload == load_case.name)
    tables, values = list[Array](), list[Array]()
    for plane, grids in enumerate(planes):
        cell = np.zeros(len(q), dtype=int)
        for j, middles in grids.items():
            place = nearest(middles, q[:, j]) if len(middles) > 1 else 0
            cell = cell * len(middles) + place
        for case, rows in rows_of.items():
            worst, spread = _worst_of_each(cell, rows, lowest, mapped.weights)
            head = np.tile([plane, case], (len(worst), 1))
            tables.append(np.column_stack([head, cell[worst], worst]))
            values.append(np.column_stack([lowest[worst], spread]))
    return _WorstPoses(table=np.concatenate(tables), frequencies=np.concatenate(values))


def _worst_of_each(cell: Array, rows: Array, lowest: Array, weights: Array) -> tuple[Array, Array]:
    """Row of the lowest frequency in every cell (m,), and percentiles of each (m, k).

    Args:
        cell: in which each row of a map lies (n,).
        rows: that count.
        lowest: frequency of each row (n,) [Hz].
        weights: of the rows (n,).
    """
    order = rows[np.lexsort((lowest[rows], cell[rows]))]
    _, first = np.unique(cell[order], return_index=True)
    spread = percentiles(lowest[order], weights[order], PERCENTS, cell[order])
    return order[first], spread


def _drawn_machine(
    label: str, mapped: _Mapped, planes: list[dict[int, Array]], units: Units
) -> DrawnMachine:
    machine, cells = mapped.machine, _cells(mapped, planes)
    kept, place = np.unique(cells.table[:, 3], return_inverse=True)
    rows = np.concatenate([[0], kept + 1])
    names = [payload.name for payload in machine.payloads]
    q, case = mapped.q[rows], np.array([names.index(name) for name in mapped.payload[rows]])
    shapes, limits, lowest = _modes(machine, q, case)
    modes = range(shapes.shape[-1])
    view = side_view(machine, q)
    swings = Swings(machine=machine, bodies=view.bodies, size=view.size)
    moved, joints = (swings.of(q, shapes[..., k]) for k in modes), picture_joints(machine, q)
    loose = _loose(view, carriers := _carriers(view, machine))
    kinds = [units.table[joint.unit] for joint in machine.arm.joints]
    printed = q / np.array([factor for factor, *_ in kinds])
    decimals = [*(digits for *_, digits in kinds), *lowest.shape[1] * [DECIMALS]]
    return DrawnMachine(
        label=label,
        parts=tuple(part.name for part in machine.yielding),
        cells=whole(np.column_stack([cells.table[:, :3], place.ravel() + 1])),
        frequencies=rounded(cells.frequencies, cells.frequencies.shape[1] * [DECIMALS]),
        poses=whole(np.column_stack([case + 1, limits])),
        positions=rounded(np.column_stack([printed, lowest]), decimals),
        standing=tuple(view.placements[0, 0].ravel().tolist()),
        placements=packed(_numbers(view, loose)),
        joints=tuple(zip(joints.carriers, joints.hinges, strict=True)),
        pivots=packed(joints.places.reshape(len(q), -1)),
        swings=packed(np.hstack([_ways(joints, swing) for swing in moved])),
        bodies=tuple(
            tuple(tuple(map(tuple, np.round(ring, 3).tolist())) for ring in body.polygons)
            for body in view.bodies
        ),
        points=_points(view, carriers, loose, machine, units),
        cylinders=_cylinders(view, machine),
        bars=tuple(vars(bar) for bar in view.bars),
        ground=view.ground,
        loops=None if mapped.loops is None else _loops(mapped.loops[rows]),
    )


def _loops(loops: Array) -> Packed:
    """Bandwidths of the ``SCHEMES`` [Hz] and the narrowest loop of each pose (n, 4)."""
    return rounded(loops, [*len(SCHEMES) * [DECIMALS], 0])


def _ways(joints: PictureJoints, swing: Swing) -> Array:
    """How far the joints of the picture and the tool go in a mode (n, k + 1)."""
    return np.column_stack([joints.turns * swing.steps, swing.tool])


def _cylinders(view: SideView, machine: Machine) -> tuple[dict[str, Any], ...]:
    colours = actuator_colours(machine)
    return tuple(
        vars(shape) | {"colour": SPRING if shape.idle else colours[shape.name]}
        for shape in view.cylinders
    )


def _modes(machine: Machine, q: Array, case: Array) -> tuple[Array, Array, Array]:
    """Shapes (n, k, m), limiting parts (n, m), frequencies (n, m) [Hz] of the m lowest modes."""
    count = len(machine.arm.coordinates)
    most = min(count, MODES)
    shapes = np.zeros((len(q), count, most))
    limits, lowest = np.zeros((len(q), most), dtype=int), np.zeros((len(q), most))
    names = [machine.payloads[k].name for k in case]
    for loaded, rows in groups_by_case(machine, names):
        poses = loaded.evaluate(loaded.rigid_poses(q[rows]))
        modes = natural_modes(poses)
        shapes[rows], lowest[rows] = modes.shapes[:, :, :most], modes.frequencies[:, :most]
        limits[rows] = energy_shares(poses, modes)[:, :most].argmax(axis=2)
    return shapes, limits, lowest


def _all_points(view: SideView) -> Array:
    """Places of all pins, then of the tool (n, np + 1, 2) [m]."""
    return np.concatenate([view.points, view.tool[:, None]], axis=1)


def _in_plate(view: SideView, body: int, places: Array) -> Array | None:
    """A point (n, 2) in the plate of its body; None where the plate does not carry it."""
    matrices = view.placements[:, body]
    if abs(np.linalg.det(matrices[0, :, :2])) < 1e-6:
        return None
    at = np.linalg.solve(matrices[0, :, :2], places[0] - matrices[0, :, 2])
    miss = matrices[:, :, :2] @ at + matrices[:, :, 2] - places
    return at if float(np.abs(miss).max()) < IN_PLATE else None


Carriers = list[tuple[str, int | None]]  # points by name, with the bodies that may carry them


def _carriers(view: SideView, machine: Machine) -> Carriers:
    """All pins and the tool, as in ``_all_points``."""
    pins = [(pin.name, pin.body) for pin in view.pins]
    return [*pins, ("tool", machine.arm.links[machine.tool.link].joint + 1)]


def _loose(view: SideView, carriers: Carriers) -> list[int]:
    """Indices of the points that no plate carries."""
    points = _all_points(view)
    return [
        i
        for i, (_, body) in enumerate(carriers)
        if body is None or _in_plate(view, body, points[:, i]) is None
    ]


def _points(
    view: SideView, carriers: Carriers, loose: list[int], machine: Machine, units: Units
) -> tuple[dict[str, Any], ...]:
    points, rows = _all_points(view), list[dict[str, Any]]()
    pins = {pin.name: pin for pin in view.pins}
    for i, (name, body) in enumerate(carriers):
        words = f"tool, on {machine.tool.link}" if name == "tool" else name
        if name in pins and pins[name].at is not None:
            x, y, z = (units.number(value, "m") for value in pins[name].at or ())
            words = f"{name}, on {pins[name].link}: x {x}, y {y}, z {z} {units.name('m')}"
        at = None
        if i not in loose and body is not None:
            carried = _in_plate(view, body, points[:, i])
            at = None if carried is None else np.round(carried, 5).tolist()
        rows.append({"name": name, "words": words, "body": body, "at": at})
    return tuple(rows)


def _numbers(view: SideView, loose: list[int]) -> Array:
    """Numbers that draw a pose (n, m): matrices of moving bodies, places of loose points."""
    n = len(view)
    parts = view.placements[:, 1:].reshape(n, -1), _all_points(view)[:, loose].reshape(n, -1)
    return np.concatenate(parts, axis=1)
