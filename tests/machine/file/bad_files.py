"""Bad machine files: how one is made from a good one, and how it is refused: by one line."""

from __future__ import annotations

import copy
import json
import math
import re
import time
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np

import armdesign as ad
from armdesign.machine.machine import Machine
from tests import machines

EXCAVATOR = machines.named("excavator_20t")


TEXT, DATA = EXCAVATOR.text, tomllib.loads(EXCAVATOR.text)


SLOWEST = 2.0  # [s] of processor time per case


def without_visuals(urdf: str) -> str:
    """Without visuals, so that random damage meets what matters."""
    robot = ET.fromstring(urdf)
    for link in robot.findall("link"):
        for part in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(part)
    return ET.tostring(robot, encoding="unicode")


URDF = without_visuals(EXCAVATOR.urdf_text)


def outcome(text: str, urdf: str = URDF, use: str = "modes") -> str:
    """The message with which a machine is refused, or "" if it loads and answers; anything else
    fails the test.

    ``use``: whether the loaded machine then gives its "modes" on a coarse grid, a whole "map", or
    nothing.
    """
    start, loaded = time.process_time(), False
    message = ""
    try:
        machine = Machine.from_text(text, urdf, Path("x.toml"))
        loaded = True
        answers(machine, use)
    except ad.ArmDesignError as error:
        message = str(error)
        assert_clear(message)
        if not loaded:
            assert message.startswith(("x.toml", DATA["urdf"])), message
            assert "; " in message, f"no remedy: {message}"
    assert time.process_time() - start < SLOWEST
    return message


def answers(machine: Machine, use: str) -> None:
    """Ask for the modes on a coarse grid, a whole map, or nothing."""
    if use == "map":
        frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, points=2))
        assert math.isfinite(frequencies.worst.frequency)
    elif use == "modes":
        space = ad.Workspace.grid(machine, points=2)
        for payload in machine.payloads:
            modes = ad.natural_modes(machine.with_payload(payload.name).at(space.rigid))
            assert np.isfinite(modes.frequencies).all()


def assert_clear(message: str) -> None:
    assert message
    assert "\n" not in message
    assert len(message) < 700, message
    assert "Traceback" not in message
    assert not re.search(r"\{\w*\}|<class |<function |object at 0x", message), message


def toml(data: Any) -> str:
    """TOML of a file's data, as inline tables; at the top level one line per key."""
    return "".join(f"{json.dumps(key)} = {_inline(value)}\n" for key, value in data.items())


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return (
            "{"
            + ", ".join(f"{json.dumps(key)} = {_inline(item)}" for key, item in value.items())
            + "}"
        )
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else repr(value)


def changed(path: str, value: Any) -> str:
    """The excavator's file with one key path set, or removed where the value is `KeyError`."""
    data = copy.deepcopy(DATA)
    *tables, leaf = path.split(".")
    node = data
    for key in tables:
        node = node.setdefault(key, {})
    if value is KeyError:
        node.pop(leaf)
    else:
        node[leaf] = value
    return toml(data)


def paths(data: dict[str, Any] = DATA, start: str = "") -> list[str]:
    """All key paths of the file, tables and leaves."""
    key_paths = []
    for key, value in data.items():
        key_paths.append(start + key)
        if isinstance(value, dict):
            key_paths += paths(value, f"{start}{key}.")
    return key_paths


# ------------------------------------------------------------------------ one thing wrong, by name

BOOM, BUCKET = DATA["cylinder"]["boom"], DATA["cylinder"]["bucket"]


FULL = DATA["payload"]["full"]


BARS = "cylinder.bucket.four_bar."
