"""The viewer on the loopback address, moved by its controls as a browser moves them."""

from __future__ import annotations

import contextlib
import re
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign.frequency.modes import natural_modes
from armdesign.units import deg
from armdesign.viewing import stage
from armdesign.viewing.live import Viewer
from armdesign.viewing.player import legend
from armdesign.viewing.view import view_of
from tests.commands import Refused, main
from tests.machines import named


@contextlib.contextmanager
def viewing(machine: ad.Machine, new: ad.Machine | None = None) -> Iterator[Viewer]:
    viewer = Viewer(view_of(machine, new, workspace=ad.Workspace.grid(machine, 3)))
    try:
        yield viewer
    finally:
        viewer.stop()


def test_it_listens_on_the_loopback_address_alone() -> None:
    """By the kernel's list of listening sockets; and it publishes itself by no tunnel."""
    with viewing(named("paper_1dof")) as viewer:
        port = viewer.server.get_port()
        lines = [
            line.split()
            for table in ("tcp", "tcp6")
            if (file := Path(f"/proc/net/{table}")).exists()
            for line in file.read_text().splitlines()[1:]
        ]
        listening = [words[1] for words in lines if words[3] == "0A"]
        assert [at for at in listening if at.endswith(f":{port:04X}")] == [f"0100007F:{port:04X}"]
        assert viewer.server.request_share_url() is None
        for origin, answer in ((viewer.address, b"101"), ("http://evil.example", b"403")):
            assert _handshake(port, origin).split()[1] == answer


def _handshake(port: int, origin: str) -> bytes:
    """The answer to a page of an origin that asks for a socket."""
    head = (
        f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        f"Sec-WebSocket-Version: 13\r\nOrigin: {origin}\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        connection.sendall(head.encode())
        return connection.recv(4096)


def test_sliders_change_pose_and_reading() -> None:
    machine = named("paper_1dof")
    with viewing(machine) as viewer:
        before = viewer.words.content
        viewer.joints[0].value = 20.0
        viewer.update()
        expected = natural_modes(machine.at([20 * deg])).frequencies[0, 0]
        assert f"<td>{expected:.3g} Hz</td>" in viewer.words.content != before
        there = viewer.stage.scene.placements(np.array([20 * deg]))["lift.rod"][1][0]
        shown = viewer.stage.shown["today"].frames["lift.rod"]
        np.testing.assert_allclose(shown.position, there, atol=1e-6)
        viewer.mass.value = 100.0
        viewer.update()
        lighter = machine.with_payload(100.0).at([20 * deg])
        higher = natural_modes(lighter).frequencies[0, 0]
        assert higher > expected
        assert f"<td>{higher:.3g} Hz</td>" in viewer.words.content
        viewer.to_worst_pose()
        worst = viewer.view.worst
        np.testing.assert_allclose(viewer.q, worst.q, atol=0.1 * deg)
        assert viewer.mass.value == machine.payload.mass


@pytest.mark.slow
def test_the_worst_pose_is_exact_though_it_lies_on_a_limit() -> None:
    """Sliders have steps; a pose beside the limit would drop the load."""
    machine = named("excavator_20t")
    with viewing(machine) as viewer:
        viewer.to_worst_pose()
        viewer.update()
        worst = viewer.view.worst
        assert viewer.readings["today"].machine.payload.name == worst.payload == "full"
        assert viewer.readings["today"].frequencies[0] == pytest.approx(worst.frequency, rel=1e-9)
        viewer.joints[0].value -= 1.0
        assert viewer.q[0] == pytest.approx(viewer.joints[0].value * deg)
        assert viewer.q[0] != worst.q[0]


def test_modes_move_the_machine_and_end_where_it_stands() -> None:
    machine = named("paper_1dof")
    with viewing(machine) as viewer:
        frame = viewer.stage.shown["today"].frames["lift.rod"]
        equilibrium = np.array(frame.position)
        viewer.swing.value = True
        places = []
        for _ in range(20):
            time.sleep(0.05)
            places.append(np.array(frame.position))
        assert np.ptp(places, axis=0).max() > 1e-3
        viewer.swing.value = False
        deadline = time.monotonic() + 10
        while not np.allclose(frame.position, equilibrium) and time.monotonic() < deadline:
            time.sleep(0.05)
        np.testing.assert_allclose(frame.position, equilibrium)


@pytest.mark.slow
def test_the_new_machine_stands_over_todays() -> None:
    """Only what differs of it is shown: changed cylinders, and moved pins as arrows."""
    machine = named("loader_crane")
    at = machine.linkages[0].base.at
    moved = [1e3 * at[0], 1e3 * at[1], 1e3 * at[2] + 5.0]
    new = machine.replace({"cylinder.lift.base.at_mm": moved, "fluid.bulk_modulus_MPa": 800})
    with viewing(machine, new) as viewer:
        shown = viewer.stage.shown["new"].scene
        names = {one.name for one in stage.differing(shown, viewer.stage.scene)}
        parts = ("lift.barrel", "lift.rod", "pins/lift.base", "pins/lift.rod_end")
        assert names == set(parts)
        arrows = viewer.stage.arrows
        assert list(arrows) == ["lift.base"]
        begin, end = np.array(arrows["lift.base"].points)[0]
        np.testing.assert_allclose(end - begin, [0, 0, 5e-3], atol=1e-6)
        frequencies = [one.frequencies[0] for one in viewer.readings.values()]
        assert frequencies[1] < frequencies[0]
        for value in frequencies:
            assert f"<td>{value:.3g} Hz</td>" in viewer.words.content


def test_text_of_files_is_no_markup() -> None:
    machine = named("paper_1dof")
    titled = re.sub(r"(?m)^title.*$", 'title = "<img src=x>"', machine.text)
    odd = ad.Machine.from_text(titled, machine.urdf_text, machine.source)
    words = legend(view_of(odd, workspace=ad.Workspace.grid(odd, 3)))
    assert "&lt;img src=x&gt;" in words
    assert "<img" not in words


def test_a_taken_port_and_a_missing_package_are_one_line(
    refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        command = ["view", "paper_1dof", "--points", "3", "--no-open", "--port", str(port)]
        refused(command, f"port {port}: cannot be used")
    monkeypatch.setattr(stage, "find_spec", lambda _: None)
    refused(["view", "paper_1dof"], 'needs the package viser; pip install "armdesign[view]"')


def test_the_command_serves_until_ctrl_c(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(viewer: Any) -> None:
        assert threading.current_thread() is threading.main_thread()
        raise KeyboardInterrupt

    monkeypatch.setattr(Viewer, "wait", interrupted)
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert main(["view", "paper_1dof", "--points", "3"], monkeypatch) == 0
    out, said = capsys.readouterr()
    assert out == ""
    assert opened[0] in said
    assert opened[0].startswith("http://127.0.0.1:")
    assert said.endswith("ended\n")
