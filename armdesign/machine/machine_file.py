"""The machine file: TOML ↔ validated schema.

The schema is the file: its keys, each with its unit in the name, its allowed range in the
annotation. A fault is answered with file, key path, value, range and remedy. Writing changes leaf
values only, so the author's comments stay.
"""

from __future__ import annotations

import difflib
import os
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import tomlkit
from annotated_types import MaxLen, MinLen
from pydantic import ValidationError
from tomlkit.exceptions import TOMLKitError

from armdesign.errors import MachineFileError
from armdesign.hydraulics.valve import RELIEF_SHARE
from armdesign.machine.key_lines import Places, lines_of
from armdesign.machine.likely_values import (
    USUAL,
    bare_point,
    comma_in,
    list_meant,
    meant,
    number_meant,
    usual,
    with_point,
)
from armdesign.machine.schema import (
    ONE_LINE,
    CylinderSection,
    MachineSection,
    Section,
    SupplySection,
    ValveSection,
    allowed,
    annotation,
    bounds,
    unit_of,
)
from armdesign.mechanism.linkage.kinds import KINDS

MENDING = 8  # passes in which tables that stand in for others are filled
COLUMNS = (
    "payload",
    "tool_x_m",
    "tool_y_m",
    "tool_z_m",
    "cylinder",
    "mode",
    "linear_hz",
    "identified_hz",
    "deviation",
)


def read_text(path: Path) -> str:
    """Text of a machine file or URDF.

    Raises:
        MachineFileError: the file is missing or is no text.
    """
    try:
        return path.read_bytes().decode(
            "utf-8-sig"
        )  # line ends as they are: saving changes values only
    except FileNotFoundError:
        raise MachineFileError(str(path), "no such file", "check the path") from None
    except UnicodeDecodeError:
        raise MachineFileError(str(path), "is not UTF-8 text", "save it as UTF-8") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = getattr(error, "strerror", None) or error
        raise MachineFileError(str(path), f"cannot be read ({reason})", "check the path") from None


def leads_out(folder: Path, urdf: str) -> bool:
    """Whether a URDF's path, symbolic links followed, ends outside a folder."""
    try:
        return not Path(os.path.realpath(folder / urdf)).is_relative_to(os.path.realpath(folder))
    except ValueError:  # a NUL in the path, which reading refuses
        return False


def read_urdf(path: Path, urdf: str, allow_outside: bool) -> str:
    """Text of the URDF that a machine file names.

    Args:
        path: of the machine file.
        urdf: as the file names it, relative to it.
        allow_outside: whether it may lie outside the file's folder.

    Raises:
        MachineFileError: it lies outside, is missing or is no text.
    """
    if not allow_outside and leads_out(path.parent, urdf):
        raise MachineFileError(
            f"{path.name}: urdf",
            f'"{urdf}" is outside the folder of the machine file',
            "put it beside the file, or allow it: --allow-outside, in Python load(…,"
            " allow_outside=True)",
        )
    try:
        return read_text(path.parent / urdf)
    except MachineFileError as error:
        raise MachineFileError(
            f"{path.name}: urdf", f'"{urdf}": {error.problem}', error.remedy
        ) from None


def parse(text: str, source: str) -> MachineSection:
    """Check a machine file's text against the schema.

    Args:
        text: TOML.
        source: file name for messages.

    Raises:
        MachineFileError: not TOML, or a key that is missing, unknown, of a wrong type or out of
            its range.
    """
    data = _toml(text, source)
    with lines_of(text, source):
        try:
            section = MachineSection.model_validate(data)
        except ValidationError as error:
            raise _explain(error, source, Places(text)) from None
        for fault in _faults_of_sense(section, source):
            raise fault
    return section


def problems(
    text: str, source: str
) -> tuple[MachineSection | None, list[MachineFileError], set[str]]:
    """Every fault that a machine file's text has by itself, not the first alone.

    Args:
        text: TOML.
        source: file name for messages.

    Returns:
        The file with stand-ins where it is wrong (None where it is no TOML), its faults, and the
        key paths at which a stand-in stands.
    """
    try:
        data = _toml(text, source)
    except MachineFileError as error:
        return None, [error], set()
    faults: list[MachineFileError] = []
    wrong: set[str] = set()
    places = Places(text)
    for _ in range(MENDING):
        try:
            section = MachineSection.model_validate(data)
            break
        except ValidationError as error:
            found = error.errors(include_url=False)
            first_pass = not faults
            for fault in found:
                if first_pass:
                    faults.append(_explained(fault, source, places))
                location = _location(fault)
                wrong.add(".".join(map(str, location)))
                _mend(data, location)
    else:
        return None, faults, wrong
    tables = {_table(path) for path in wrong}
    faults += [
        fault
        for fault in _faults_of_sense(section, source)
        if _table(fault.part.removeprefix(f"{source}: ")) not in tables
    ]
    return section, faults, wrong


def dump(data: Mapping[str, Any], heading: str) -> str:
    """Text of a machine file that holds some data, pins and volumes in one line each, below a comment.

    Raises:
        MachineFileError: a value that TOML cannot hold.
    """
    document = tomlkit.document()
    document.add(tomlkit.comment(heading))
    for key, value in data.items():
        document[key] = _item(value, str(key))
    return tomlkit.dumps(document)


def _item(value: Any, path: str) -> Any:
    value = _plain(value)
    if isinstance(value, Mapping):
        table = tomlkit.inline_table() if value and set(value) <= ONE_LINE else tomlkit.table()
        for key, item in value.items():
            if item is not None:
                table[str(key)] = _item(item, f"{path}.{key}")
        return table
    try:
        return tomlkit.item(value)
    except (TypeError, ValueError, TOMLKitError):
        raise MachineFileError(
            path, f"cannot hold {value!r}", "give a number, a text, a list or a table"
        ) from None


def flat(section: MachineSection) -> dict[str, Any]:
    """Every value of a machine file by its key path, defaults included; lists whole."""
    found: dict[str, Any] = {}

    def walk(value: Any, path: str) -> None:
        if isinstance(value, dict):
            for key, item in value.items():
                walk(item, f"{path}.{key}" if path else key)
        elif value is not None:
            found[path] = value

    walk(section.model_dump(), "")
    return found


def _table(path: str) -> str:
    """The part of the file whose keys must agree with each other: ``cylinder.boom`` of ``cylinder.boom.rod_mm``."""
    words = path.split(".")
    return ".".join(words[: 2 if words[0] in ("payload", "cylinder") else 1])


def _mend(data: Any, location: tuple[Any, ...]) -> None:
    """Take out what is wrong at a key path, or put a stand-in where something is needed."""
    node = data
    try:
        for key in location[:-1]:
            node = node[key]
        parent, _ = annotation(location[:-1])
    except (KeyError, IndexError, TypeError):
        return  # gone with a table that was wrong as a whole
    fields = (
        parent.model_fields if isinstance(parent, type) and issubclass(parent, Section) else {}
    )
    leaf = location[-1]
    if isinstance(node, list):
        if leaf < len(node):
            node[leaf] = _stand_in(location)
    elif leaf in fields and fields[leaf].is_required():
        node[leaf] = _stand_in(location)
    else:
        node.pop(leaf, None)


def _stand_in(location: tuple[Any, ...]) -> Any:
    """A value that the schema allows at a key path, tables empty."""
    kind, constraints = annotation(location)
    if get_origin(kind) is Literal:
        return get_args(kind)[0]
    if kind in (float, int):
        return kind(1)
    if get_origin(kind) is list:
        least = next((c.min_length for c in constraints if isinstance(c, MinLen)), 0)
        return [_stand_in((*location, 0))] * least
    if kind is str:
        return "stand_in"
    return {"stand_in": {}} if get_origin(kind) is dict else {}


def _toml(text: str, source: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (
        ValueError,
        RecursionError,
    ) as error:  # ValueError: TOMLDecodeError, and a whole number of 5000 digits
        words = str(error).removesuffix("(at end of document)").strip()
        if isinstance(error, RecursionError):
            words = "nested too deeply"
        if number := _ill_written(text, words):
            raise MachineFileError(source, *number) from None
        if not re.search(r"\(at line \d+, column \d+\)$", words):
            words += f" (at {_place(text, error)})"
        xml = text.lstrip().startswith("<")  # most likely the URDF itself was given
        remedy = (
            "give the .toml file that names the URDF" if xml else "correct the file at that place"
        )
        raise MachineFileError(source, f"not valid TOML: {words}", remedy) from None


def _ill_written(text: str, words: str) -> tuple[str, str] | None:
    """Problem and remedy where the line that the parser does not like has a number with a comma, or a bare point."""
    place = re.search(r"\(at line (\d+), column \d+", words)
    lines = text.splitlines()
    line = lines[int(place[1]) - 1] if place and int(place[1]) <= len(lines) else ""
    if place is None:
        return None
    if point := bare_point(line):
        return f"not valid TOML: no digit on one side of a point {place[0]})", point
    if (comma := comma_in(line)) is None:
        return None
    at = f"(at line {place[1]}, column {comma.start(1) + comma[1].index(',') + 1})"
    return f"not valid TOML: a decimal comma in {comma[1]} {at}", with_point(comma[1])


def _place(text: str, error: Exception) -> str:
    """Line and column of what the parser found wrong without saying where: the end, a huge number, a deep nest."""
    at = len(text)
    if not isinstance(
        error, tomllib.TOMLDecodeError
    ):  # both are in the longest line of any file that was not built so
        at = text.index(max(text.split("\n"), key=len))
    return f"line {text.count(chr(10), 0, at) + 1}, column {at - text.rfind(chr(10), 0, at)}"


def write(text: str, changes: dict[str, Any], source: str) -> str:
    """The text with the leaf values at some key paths changed and all else, comments included, as it was.

    Raises:
        MachineFileError: a path that the file's schema does not have.
    """
    try:
        document = tomlkit.parse(text)
    except (TOMLKitError, ValueError, RecursionError) as error:
        raise MachineFileError(
            source, f"cannot be edited: {error}", "write it as plainer TOML"
        ) from None
    for path, value in changes.items():
        if not isinstance(path, str) or not path:
            raise MachineFileError(
                source, f"{path!r} is not a key path", "give one such as cylinder.boom.bore_mm"
            )
        *tables, leaf = path.split(".")
        node: Any = document
        for depth, key in enumerate(tables):
            if key not in node:
                _refuse_new_table(tuple(tables[: depth + 1]), node, f"{source}: {path}")
                node[key] = tomlkit.inline_table()
            node = node[key]
            if not hasattr(node, "keys"):
                raise MachineFileError(
                    f"{source}: {path}", f'"{key}" is a value, not a table', "shorten the path"
                )
        _set_leaf(node, leaf, value, f"{source}: {path}")
    return tomlkit.dumps(document)


def _refuse_new_table(location: tuple[str, ...], node: Any, where: str) -> None:
    """Raise unless the schema knows this as an optional table: load cases and cylinders are not made by a change."""
    parent, _ = annotation(location[:-1])
    known = (
        parent.model_fields if isinstance(parent, type) and issubclass(parent, Section) else node
    )
    if known is node or location[-1] not in known:
        raise MachineFileError(
            where, f'no "{location[-1]}" in the file', f"choose from: {', '.join(known)}"
        )


def _plain(value: Any) -> Any:
    """Numbers and lists of numpy as Python's own."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def _set_leaf(node: Any, leaf: str, value: Any, where: str) -> None:
    old, value = node.get(leaf), _plain(value)
    if isinstance(old, dict):
        raise MachineFileError(where, "is a table, not a value", "name one of its keys")
    try:
        if isinstance(old, list) and isinstance(value, list) and len(old) == len(value):
            for index, item in enumerate(
                value
            ):  # element by element: spacing and comments of the list stay
                if old[index] != item:  # so that 0 does not become 0.0
                    old[index] = item
        else:
            node[leaf] = value
    except (TypeError, ValueError, TOMLKitError):
        raise MachineFileError(
            where, f"cannot hold {value!r}", "give a number or a text"
        ) from None


# ---------------------------------------------------------------------------------------- messages


def _explain(error: ValidationError, source: str, places: Places) -> MachineFileError:
    faults = error.errors(include_url=False)
    # an unknown key next to a missing one is most likely a misspelling: say the one that holds the
    # remedy
    fault = next((f for f in faults if f["type"] == "extra_forbidden"), faults[0])
    return _explained(
        fault, source, places, f" ({len(faults) - 1} more in this file)" if len(faults) > 1 else ""
    )


def _location(fault: Any) -> tuple[Any, ...]:
    return tuple(part for part in fault["loc"] if part != "[key]")


def _explained(fault: Any, source: str, places: Places, more: str = "") -> MachineFileError:
    """One fault of the schema in the package's words, the most likely cause first."""
    location = _location(fault)
    path = ".".join(str(part) for part in location)
    where, may_be = f"{source}: {path}", allowed(location)
    if fault["type"] == "missing":
        return MachineFileError(where, "missing", f"add {location[-1]}: {may_be}{more}")
    if fault["type"] == "extra_forbidden":
        kind, _ = annotation(location[:-1])
        close = difflib.get_close_matches(str(location[-1]), kind.model_fields, n=1, cutoff=0.5)
        hint = (
            f'did you mean "{close[0]}"?'
            if close
            else f"known keys: {', '.join(kind.model_fields)}"
        )
        return MachineFileError(where, "unknown key", hint + more)
    if fault["loc"][-1:] == ("[key]",):
        return MachineFileError(
            where,
            "is not a usable name",
            "start with a letter, then letters, digits, _ or -" + more,
        )
    problem, remedy = (
        f"{_shown(fault['input'])} is not allowed",
        f"give {may_be or 'another value'}{more}",
    )
    cause, mended = _likely(fault, location, places.written(path))
    if cause:
        problem, remedy = f"{cause}: {problem}", f"{mended}; {remedy}"
    elif mended:
        remedy = f"{remedy}; {mended}"
    return MachineFileError(where, problem, remedy)


def _likely(fault: Any, location: tuple[Any, ...], written: str) -> tuple[str, str]:
    """What a value that is not allowed was most likely meant to be, and what to write.

    Both "" if that is not plain.
    """
    value, unit = fault["input"], unit_of(location).strip()
    kind, constraints = annotation(location)
    if kind in (int, float) and isinstance(value, str):
        return number_meant(value, unit)
    if isinstance(value, list) and get_origin(kind) is list:
        most = next((c.max_length for c in constraints if isinstance(c, MaxLen)), 0)
        points = list_meant(written, most) if written else ""
        return ("decimal commas", f"write {points}") if points else ("", "")
    known, lower, upper = usual(location), *bounds(location)
    if kind is float and (
        found := meant(
            location, value, known if location[-1] in USUAL else lambda x: lower < x < upper
        )
    ):
        return f"looks like {found.unit}", found.remedy
    return "", ""


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "a table" if value else "an empty table"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    if isinstance(value, list):
        text = f"[{', '.join(_shown(item) for item in value)}]"
    elif isinstance(value, str):
        text = f'"{value}"'
    return text if len(text) <= 60 else text[:57] + "…"


def _faults_of_sense(machine: MachineSection, source: str) -> list[MachineFileError]:
    """What the schema cannot say: keys that must agree with each other."""
    faults: list[MachineFileError] = []

    def refuse(path: str, problem: str, remedy: str) -> None:
        faults.append(MachineFileError(f"{source}: {path}", problem, remedy))

    if len(set(machine.joints)) < len(machine.joints):
        refuse("joints", "a joint is named twice", "name each joint once")
    for name in machine.joints:
        if name in COLUMNS or re.fullmatch(r"f\d+_hz", name):
            refuse("joints", f'"{name}" is a column of the CSV files', "rename the joint")
    for name in machine.motor:
        if name in machine.cylinder:
            refuse(
                f"motor.{name}",
                "is the name of a cylinder too",
                "give each actuator a name of its own",
            )
    if Path(machine.urdf).name in ("", ".."):
        refuse("urdf", f'"{machine.urdf}" is no file name', "name the URDF")
    back, supply = machine.supply.return_pressure_bar, machine.supply.pressure_bar
    if back >= supply:
        keys = ("supply", "return_pressure_bar")
        unit = meant(keys, back, usual(keys))
        problem, remedy = (
            f"{back:g} bar is not below the supply's {supply:g} bar",
            "give a lower return pressure",
        )
        if unit and back > 100:
            remedy = f"it looks like {unit.unit}: {unit.remedy}, or {remedy}"
        refuse("supply.return_pressure_bar", problem, remedy)
    for name, payload in machine.payload.items():
        if payload.mass_kg > 0 and (payload.link is None or payload.at_mm is None):
            missing = "link" if payload.link is None else "at_mm"
            refuse(
                f"payload.{name}.{missing}", "missing: a mass must sit somewhere", f"add {missing}"
            )
        if payload.pitch_deg is not None:
            low, high = payload.pitch_deg
            if not low < high or high - low > 360:
                refuse(
                    f"payload.{name}.pitch_deg",
                    f"[{low:g}, {high:g}] deg is empty",
                    "give [lower, upper] within one turn",
                )
            if payload.link is None:
                refuse(f"payload.{name}.link", "missing: the pitch is that of a link", "add link")
    for name, cylinder in machine.cylinder.items():
        _check_cylinder(f"cylinder.{name}", cylinder, refuse)
    for name, motor in machine.motor.items():
        _check_hoses(f"motor.{name}", motor.hose, motor.trapped_volume_l, refuse)
        _check_friction(
            f"motor.{name}.friction",
            motor.friction.static_N_m,
            motor.friction.coulomb_N_m,
            "N m",
            refuse,
        )
    for kind, actuators in (("cylinder", machine.cylinder), ("motor", machine.motor)):
        for name, actuator in actuators.items():
            _check_preload(f"{kind}.{name}.valve", actuator.valve, machine.supply, refuse)
    for key, band in machine.bands:
        if band and not band[0] <= band[1]:
            refuse(
                f"bands.{key}", f"[{band[0]:g}, {band[1]:g}] is upside down", "give [lower, upper]"
            )
    _check_requirements(machine, refuse)
    return faults


def _check_requirements(machine: MachineSection, refuse: Any) -> None:
    """Names of cylinders and joints that requirements give."""
    asked, cylinders, joints = machine.requirements, machine.cylinder, machine.joints
    named: list[tuple[str, str, Iterable[str], Iterable[str]]] = [
        (
            "digging.cylinders",
            "cylinder",
            asked.digging.cylinders if asked.digging else [],
            cylinders,
        ),
        ("digging_kN", "cylinder", asked.digging_kN, cylinders),
        ("pin_boxes_mm", "cylinder", asked.pin_boxes_mm, cylinders),
    ]
    for name, speed in asked.speed.items():
        named += [
            (f"speed.{name}.joint_deg_per_s", "joint", speed.joint_deg_per_s, joints),
            (f"speed.{name}.joint_mm_per_s", "joint", speed.joint_mm_per_s, joints),
            (f"speed.{name}.cylinder_mm_per_s", "cylinder", speed.cylinder_mm_per_s, cylinders),
        ]
    for name, lift in asked.lift.items():
        named += [
            (f"lift.{name}.joint_deg", "joint", lift.joint_deg, joints),
            (f"lift.{name}.joint_mm", "joint", lift.joint_mm, joints),
        ]
        if (lift.reach_mm is None) != (lift.height_mm is None):
            missing = "reach_mm" if lift.reach_mm is None else "height_mm"
            refuse(
                f"requirements.lift.{name}.{missing}",
                "missing: a place has both",
                f"add {missing}",
            )
    for name, clearance in asked.clearance.items():
        named += [(f"clearance.{name}.cylinders", "cylinder", clearance.cylinders, cylinders)]
    for path, kind, names, known in named:
        for name in names:
            if name not in known:
                refuse(
                    f"requirements.{path}",
                    f'no {kind} "{name}"',
                    f"choose from: {', '.join(known)}",
                )


def _check_cylinder(path: str, cylinder: CylinderSection, refuse: Any) -> None:
    bore, rod, closed = cylinder.bore_mm, cylinder.rod_mm, cylinder.closed_length_mm
    slender = bore < closed / 40  # as no barrel is
    unit = meant(
        ("cylinder", path, "bore_mm"), bore, lambda x: slender and 0.3 * x <= rod <= 0.9 * x
    )
    if rod >= bore and unit:
        problem = f"{bore:g} mm looks like {unit.unit}: the rod of {rod:g} mm does not fit it"
        refuse(f"{path}.bore_mm", problem, f"{unit.remedy}, or give a rod in (0, {bore:g}) mm")
    elif rod >= bore:
        refuse(
            f"{path}.rod_mm",
            f"{cylinder.rod_mm:g} mm does not fit the bore",
            f"give a rod in (0, {cylinder.bore_mm:g}) mm",
        )
    keys = [kind.key for kind in KINDS]
    given = [key for key in keys if getattr(cylinder, key) is not None]
    if len(given) != 1:
        words = f"both {' and '.join(given)}" if given else f"neither {' nor '.join(keys)}"
        refuse(f"{path}.{keys[0]}", f"{words} given", "give exactly one of them")
    _check_hoses(path, cylinder.hose, cylinder.dead_volume_l, refuse)
    _check_friction(
        f"{path}.friction", cylinder.friction.static_N, cylinder.friction.coulomb_N, "N", refuse
    )


def _check_preload(
    path: str, valve: ValveSection | None, supply: SupplySection, refuse: Any
) -> None:
    """A shut chamber keeps no less than return pressure, and no more than its relief holds."""
    if valve is None or valve.preload_bar is None:
        return
    back, own = supply.return_pressure_bar, valve.relief_bar
    relief = round(RELIEF_SHARE * supply.pressure_bar, 6) if own is None else own
    if not back <= valve.preload_bar < relief:
        low, high = "return pressure", "1.1 × supply pressure" if own is None else "relief_bar"
        remedy = f"give a pressure in [{back:g}, {relief:g}) bar, from {low} to below {high}"
        refuse(f"{path}.preload_bar", f"{valve.preload_bar:g} bar is not allowed", remedy)


def _check_hoses(path: str, hose: Section, volumes: Section, refuse: Any) -> None:
    """Hoses hold a share of the oil that the piston does not sweep, not more."""
    for side in type(volumes).model_fields:
        inside, whole = getattr(hose, f"{side}_l"), getattr(volumes, side)
        if inside > whole:
            key = f"{path}.hose.{side}_l"
            refuse(
                key, f"{inside:g} l exceeds the dead volume", f"give a volume in [0, {whole:g}] l"
            )


def _check_friction(path: str, static: float, coulomb: float, unit: str, refuse: Any) -> None:
    if static and static < coulomb:
        key = f"{path}.static_{unit.replace(' ', '_')}"
        refuse(
            key,
            f"{static:g} {unit} is below the Coulomb friction",
            f"give 0 or at least {coulomb:g} {unit}",
        )
