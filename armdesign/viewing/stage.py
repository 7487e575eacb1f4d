"""The stage: machines shown by viser, on this computer alone. The only door to viser.

The server listens on the loopback address, refuses to publish itself by a tunnel, and lets no
page of another origin speak with it.
"""

from __future__ import annotations

import contextlib
import io
import socket
from collections.abc import Iterator
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.drawing.joint_arcs import middle_pose
from armdesign.drawing.moved_pins import moved_pins
from armdesign.drawing.side_view import side_view
from armdesign.errors import ArmDesignError
from armdesign.plots.canvas import MARK
from armdesign.units import mm
from armdesign.viewing.scene import Scene, Solid, scene_of

if TYPE_CHECKING:
    from armdesign.machine.load_case import LoadCase
    from armdesign.machine.machine import Machine
    from armdesign.viewing.region import ReachRegion
    from armdesign.viewing.view import View

LOOPBACK = "127.0.0.1"
PORT = 8080  # the first that is tried
PORTS = 100  # how many are
DENSITY = 3000.0  # [kg/m³] of a drawn load
TOOL = 0.008  # of the machine's size: radius of its mark
ARROW = 0.003  # of the machine's size: radius of the arrow of a moved pin
GHOST = 0.45  # opacity of the other machine
GREY = (120, 130, 140)
FIELD = np.radians(35.0)  # of view, from below upwards
CLOSE = 1.1  # distance of the first view over the width of what is to be seen,
WORDS = 0.15  # of the height of what is to be seen: room for words above it
WIDE = 1.5  # or over its height times this


def check_viser() -> None:
    """Raise if viser is not installed.

    Raises:
        ArmDesignError: it is not.
    """
    if find_spec("viser") is None:
        remedy = 'pip install "armdesign[view]"'
        raise ArmDesignError("view", "needs the package viser", remedy)


def free_port(port: int | None) -> int:
    """A port of the loopback address that can be listened on; None: the first from ``PORT``.

    Raises:
        ArmDesignError: the port is taken, or cannot be used.
    """
    tried = [port] if port is not None else range(PORT, PORT + PORTS)
    reason = ""
    for candidate in tried:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LOOPBACK, candidate))
            except OSError as error:
                reason = str(error.strerror).lower()
                continue
        return candidate
    name = str(port) if port is not None else f"{PORT} to {PORT + PORTS - 1}"
    remedy = "give another by --port, or none: the first free one from 8080"
    raise ArmDesignError(f"port {name}", f"cannot be used ({reason})", remedy)


def serve(port: int | None, title: str) -> Any:
    """A viser server on the loopback address.

    Args:
        port: of the server; None: the first free one.
        title: above the controls.

    Raises:
        ArmDesignError: viser is not installed, or the port cannot be used.
    """
    check_viser()
    import viser

    chosen = free_port(port)

    class Server(viser.ViserServer):  # type: ignore[misc]
        """A server that stays on this computer."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            """No address: a tunnel would publish the machine."""
            return None

        def stop(self) -> None:
            """End it without a word."""
            with contextlib.redirect_stdout(io.StringIO()):
                super().stop()

    with _own_origin(chosen), contextlib.redirect_stdout(io.StringIO()):
        server = Server(host=LOOPBACK, port=chosen, label=title, verbose=False)
    if server.get_port() != chosen:  # taken since
        server.stop()
        raise ArmDesignError(f"port {chosen}", "is taken", "try again, or give another by --port")
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    server.gui.main_panel.dock_right()
    return server


@contextlib.contextmanager
def _own_origin(port: int) -> Iterator[None]:
    """While a server starts: its sockets answer to its own page only, which viser cannot say."""
    from functools import partial

    from websockets.asyncio import server

    listen = server.serve
    pages = [f"http://{host}:{port}" for host in (LOOPBACK, "localhost")]
    server.serve = partial(listen, origins=[*pages, None])
    try:
        yield
    finally:
        server.serve = listen


class Stage:
    """A view on a server, without controls.

    Args:
        view: what is looked at.
        port: of the server; None: the first free one.
        plates: whether links are plates of their outlines, which is less to send.

    Attributes:
        shown: the machines by what they are called.
        scene: today's machine.
        above: a place over all that is seen [m].
    """

    def __init__(self, view: View, port: int | None = None, plates: bool = False) -> None:
        self.server = server = serve(port, view.machine.section.title or view.machine.name)
        self.scene = scene_of(view.machine, plates)
        self.shown = {"today": ShownMachine(server, self.scene, "/today")}
        if view.new is not None:
            self.shown["new"] = ShownMachine(
                server, scene_of(view.new, plates), "/new", self.scene
            )
            self.arrows = self._arrows(view.machine, view.new)
        add_ground(server, self.scene)
        self.swept = add_region(server, view.region)
        turn, low, high = extent(self.scene, view.region)
        self.above = turn @ np.array([(low[0] + high[0]) / 2, 0.0, high[2]])
        look(server, turn, low, high + WORDS * (high[2] - low[2]) * np.eye(3)[2])

    def _arrows(self, machine: Machine, new: Machine) -> dict[str, Any]:
        """Arrows from old to new places of moved pins, with their way.

        They lie on the near side of their link, which would hide them.
        """
        known = {mark.name: mark for mark in self.scene.marks}
        radius, arrows = ARROW * self.scene.size, {}
        views = (side_view(one, middle_pose(machine)) for one in (machine, new))
        for move in moved_pins(*views):
            side, begin = self.scene.near_side(move.link)
            at = np.array(known[move.name].at)
            old = at + (begin - 2 * radius - at @ side) * side
            name = node("/new", move.link, f"moved_{move.name}")
            arrows[move.name] = self.server.scene.add_arrows(
                name,
                np.array([[old, old + move.by]]),
                rgb(MARK),
                shaft_radius=radius,
                head_radius=2 * radius,
                head_length=min(4 * radius, move.distance / 2),
            )
            self.server.scene.add_label(
                f"{name}_words",
                f"{move.name} {move.distance / mm:.0f} mm",
                position=old + move.by,
                font_screen_scale=0.7,
                anchor="bottom-center",
            )
        return arrows

    def place(self, q: Array) -> None:
        """Bring all machines into a pose q (nq,), and the region to the side of the arm."""
        for one in self.shown.values():
            one.place(q)
        turn = wxyz(self.scene.heading(q))
        if not np.allclose(turn, self.swept.wxyz):
            self.swept.wxyz = turn

    def stop(self) -> None:
        """End the server."""
        self.server.stop()


class ShownMachine:
    """A machine on the stage.

    Args:
        server: the viser server.
        scene: the machine.
        under: name in the tree of the scene below which it stands.
        beside: another machine, beside which only what differs is shown, see-through.
    """

    def __init__(self, server: Any, scene: Scene, under: str, beside: Scene | None = None) -> None:
        self.server, self.scene, self.under = server, scene, under
        ghost = beside is not None
        self.top = server.scene.add_frame(under, show_axes=False)
        frames = dict.fromkeys(solid.frame for solid in scene.solids)
        frames |= dict.fromkeys(mark.frame for mark in scene.marks)
        cases = (case for case in scene.machine.payloads if case.link)
        frames |= dict.fromkeys(str(case.link) for case in cases)
        self.frames = {
            name: server.scene.add_frame(node(under, name), show_axes=False) for name in frames
        }
        for solid in scene.solids if beside is None else differing(scene, beside):
            server.scene.add_mesh_simple(
                node(under, solid.frame, solid.name),
                solid.mesh.vertices.astype(np.float32),
                solid.mesh.faces.astype(np.uint32),
                color=rgb(MARK) if ghost else rgb(solid.colour),
                opacity=GHOST if ghost else None,
                flat_shading=True,
                side="double",
                cast_shadow=False,
            )
        self.load: Any = None
        if beside is None:
            tool = scene.marks[-1]
            server.scene.add_icosphere(
                node(under, tool.frame, "tool"),
                radius=TOOL * scene.size,
                color=rgb(MARK),
                position=tool.at,
            )

    def place(self, z: Array) -> None:
        """Bring the machine into a pose z (nq,) or with springs (k,)."""
        placements = self.scene.placements(z)
        with self.server.atomic():
            self.move({name: (turn[0], at[0]) for name, (turn, at) in placements.items()})

    def move(self, placements: dict[str, tuple[Array, Array]]) -> None:
        """Bring its frames to rotations (3, 3) and places (3,) [m]."""
        for name, frame in self.frames.items():
            turn, at = placements[name]
            known = bool(np.all(np.isfinite(turn)) and np.all(np.isfinite(at)))
            if frame.visible != known:
                frame.visible = known
            if known:
                frame.wxyz, frame.position = wxyz(turn), at

    def bear(self, case: LoadCase) -> None:
        """Show the mass of a load case as a ball."""
        if self.load is not None:
            self.load.remove()
            self.load = None
        if case.link is None or case.mass <= 0:
            return
        radius = (3 * case.mass / (4 * np.pi * DENSITY)) ** (1 / 3)
        self.load = self.server.scene.add_icosphere(
            node(self.under, case.link, "load"),
            radius=radius,
            color=GREY,
            opacity=0.8,
            position=case.at,
        )

    def label(self, shown: bool) -> list[Any]:
        """Names beside pins and tool."""
        return [
            self.server.scene.add_label(
                node(self.under, mark.frame, f"name_{mark.name}"),
                mark.name,
                position=mark.at,
                visible=shown,
                font_screen_scale=0.7,
            )
            for mark in self.scene.marks
        ]


def wxyz(rotation: Array) -> Array:
    """A rotation (3, 3) as a quaternion (4,), real part first."""
    from viser.transforms import SO3

    return np.asarray(SO3.from_matrix(rotation).wxyz)


def node(under: str, *names: str) -> str:
    """Name in the tree of the scene; a slash in a link's name makes no branch."""
    return "/".join([under, *(name.replace("/", "_") for name in names)])


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of ``#RRGGBB``."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


def differing(scene: Scene, other: Scene) -> list[Solid]:
    """Solids that another scene has not: links of another shape, cylinders of another table."""
    links = [one.mesh.vertices for one in other.solids if one.name.startswith("links/")]
    tables, others = (one.machine.section.cylinder for one in (scene, other))
    changed = [f"{name}." for name, table in tables.items() if others.get(name) != table]
    return [
        one
        for one in scene.solids
        if one.name.removeprefix("pins/").startswith(tuple(changed))
        or (
            one.name.startswith("links/")
            and not any(np.array_equal(one.mesh.vertices, corners) for corners in links)
        )
    ]


def add_ground(server: Any, scene: Scene) -> None:
    """The ground as a grid of metres."""
    server.scene.configure_default_lights(cast_shadow=False)  # slow without a graphics card
    server.scene.add_grid(
        "/ground",
        plane="xy",
        position=(0.0, 0.0, scene.ground),
        infinite_grid=True,
        cell_size=1.0 if scene.size > 2 else 0.1,
        section_size=5.0 if scene.size > 2 else 1.0,
        fade_distance=6 * scene.size,
    )


def look(server: Any, turn: Array, low: Array, high: Array) -> None:
    """Look from the side on what lies between two corners (3,) [m] of a frame turned so (3, 3)."""
    middle, size = (low + high) / 2, high - low
    away = CLOSE * max(float(size[0]), WIDE * float(size[2]))
    server.initial_camera.look_at = turn @ middle
    server.initial_camera.position = turn @ (middle + away * np.array([0.25, -0.93, 0.27]))
    server.initial_camera.fov = FIELD


def extent(scene: Scene, region: ReachRegion) -> tuple[Array, Array, Array]:
    """How an arm in the middle of its ranges points (3, 3), and between which corners it reaches.

    The lower and the upper corner (3,) [m] are in a frame that is turned so: x is ahead.
    """
    middle = middle_pose(scene.machine)
    placements, turn = scene.placements(middle), scene.heading(middle)
    corners = [
        solid.mesh.vertices @ placements[solid.frame][0][0].T + placements[solid.frame][1][0]
        for solid in scene.solids
    ]
    reach, up = region.middles.T
    swept = np.array([[reach.min(), 0, up.min()], [reach.max(), 0, up.max()]])
    points = np.concatenate([np.concatenate(corners) @ turn, swept])
    return turn, np.nanmin(points, axis=0), np.nanmax(points, axis=0)


def add_region(server: Any, region: ReachRegion) -> Any:
    """The swept region behind the machine's middle plane, in a frame that slews with the arm."""
    frame = server.scene.add_frame("/swept", show_axes=False)
    width, height = region.sides
    square = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]]) / 2
    square = square * np.array([width, 1.0, height])
    reach, up = region.middles.T
    count = len(reach)
    server.scene.add_batched_meshes_simple(
        "/swept/region",
        square.astype(np.float32),
        np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32),
        batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        batched_positions=np.column_stack([reach, np.zeros(count), up]),
        batched_colors=np.rint(255 * region.colours).astype(np.uint8),
        lod="off",
        side="double",
        cast_shadow=False,
        receive_shadow=False,
    )
    return frame
