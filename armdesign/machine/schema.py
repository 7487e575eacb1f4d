"""The schema of the machine file: its keys, each with its unit in the name and its allowed range in the annotation.

Also what the schema says at a key path, in words: for messages and for editors (JSON Schema).
"""

from __future__ import annotations

import json
import math
import re
from typing import Annotated, Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel, ConfigDict, Field

NAME_PATTERN, NAME_LENGTH = r"^[A-Za-z_][A-Za-z0-9_-]*$", 64
Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=NAME_LENGTH)]
Text = Annotated[str, Field(min_length=1, max_length=200)]
Length = Annotated[float, Field(gt=0, le=100_000)]
Volume = Annotated[float, Field(ge=0, le=10_000)]
Flow = Annotated[float, Field(gt=0, le=100_000)]
Mass = Annotated[float, Field(ge=0, le=1_000_000)]
Pressure = Annotated[float, Field(gt=0, le=5_000)]
Share = Annotated[float, Field(gt=0, le=1)]
Ratio = Annotated[float, Field(gt=0, le=10)]
Coordinate = Annotated[float, Field(ge=-100_000, le=100_000)]
Point = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]
Distance = Annotated[float, Field(ge=0, le=100_000)]
Rate = Annotated[float, Field(ge=-100_000, le=100_000)]
Corner = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Polygon = Annotated[list[Corner], Field(min_length=3, max_length=200)]
Angle = Annotated[float, Field(ge=-360, le=360)]

UNITS = {  # by the end of the key, longer ends first
    "kg_per_m3": "kg/m³",
    "rad_per_N_m": "rad/(N m)",
    "N_m_s_per_rad": "N m s/rad",
    "deg_per_s": "deg/s",
    "cm3": "cm³",
    "l_per_min_per_bar": "l/min/bar",
    "l_per_min": "l/min",
    "mm_per_s": "mm/s",
    "m_per_N": "m/N",
    "N_s_per_m": "N s/m",
    "ms": "ms",
    "percent": "%",
    "MPa": "MPa",
    "bar": "bar",
    "deg": "deg",
    "mm": "mm",
    "kg": "kg",
    "hz": "Hz",
    "kN": "kN",
    "N_m": "N m",
    "N": "N",
    "l": "l",
}
UNIT_END = re.compile(rf"_({'|'.join(UNITS)})$")
DESCRIPTIONS = {  # what an editor shows at a key; its unit is added
    "name": "short name: letters, digits, _ and -",
    "title": "name for people",
    "urdf": "the URDF, relative to this file",
    "joints": "the coordinates, in this order; every other joint of the URDF is frozen",
    "frozen": "values of frozen joints [rad or m]; 0 where none is given",
    "tool": "the point whose place is reported",
    "payload": "load cases by name; the worst one counts",
    "cylinder": "hydraulic actuators by name",
    "link": "link of the URDF",
    "at_mm": "x, y, z in the frame of the link",
    "pitch_deg": "the case exists only while the link's x axis has this pitch, up from forward",
    "bulk_modulus_MPa": "of oil without air, or of the hose",
    "entrained_air_percent": "by volume at atmospheric pressure",
    "flow_l_per_min": "of the pump",
    "count": "equal cylinders in parallel that share their pins",
    "bore_mm": "inner diameter of the barrel",
    "rod_mm": "diameter of the rod",
    "closed_length_mm": "pin to pin, rod in",
    "dead_volume_l": (
        "oil that the piston never sweeps, hoses included, all parallel cylinders together"
    ),
    "base": "pin of the barrel",
    "rod_end": "pin of the rod; or give four_bar",
    "four_bar": "rocker and coupler that the rod end drives",
    "pivot": "pin of the rocker",
    "lug": "pin of the coupler on the driven link",
    "rocker_mm": "pivot to knee",
    "coupler_mm": "knee to lug",
    "knee": "side of the line from pivot to lug, seen with x right and z up",
    "barrel_kg": "of each cylinder",
    "rod_kg": "of each cylinder",
    "compliance_m_per_N": "of pins, brackets and links in series, all together",
    "hose": "the share of the dead volume that lies in hoses",
    "motor": "hydraulic motors by name, on joints that turn without end",
    "joint": "joint that the motor turns; default: the one of the motor's name",
    "displacement_cm3": "oil per turn of one motor",
    "gear_ratio": "turns of a motor per turn of the joint",
    "trapped_volume_l": (
        "oil between valve and pistons, hoses included, all parallel motors together; a drives"
        " forward"
    ),
    "compliance_rad_per_N_m": "of gear and mounting in series, at the joint",
    "valve": "one valve for all parallel cylinders or motors together",
    "rated_drop_bar": "per metering edge",
    "overlap_percent": "of full spool stroke; negative: underlap",
    "leakage_l_per_min_per_bar": "across the piston, all parallel cylinders or motors together",
    "tank_leakage_l_per_min_per_bar": (
        "from each chamber to the tank, all parallel cylinders or motors together"
    ),
    "stroke_time_ms": "least time of the spool from its middle to its end; default: no limit",
    "relief_bar": "where the port reliefs open; default: 1.1 × supply pressure",
    "preload_bar": (
        "of the chamber without load while the valve is shut and tight; default: return pressure"
    ),
    "edges": "gains of the four metering edges, relative to the rated flow",
    "load_holding": "counterbalance or pilot-operated check valve on one chamber",
    "side": "the chamber that it holds",
    "setting_bar": "chamber pressure that opens it without pilot pressure",
    "pilot_ratio": "weight of the other chamber's pressure in opening it",
    "opening_range_bar": "from where it opens to where it is fully open",
    "pump": "ideal: holds its pressure; flow_limited: gives no more than its flow",
    "cut_off_percent": "last share of its pressure in which a flow-limited pump cuts off its flow",
    "line_volume_l": "oil between a flow-limited pump and its valves",
    "friction": "per cylinder; of a motor at the joint, all together",
    "bands": "what is not known exactly: [lower, upper] as shares of this file's values",
    "requirements": "what a new design must keep, relative to today's machine",
    "end_margin": "share of the stroke that stays free at both ends",
    "holding_share": "static force over what supply against return pressure gives",
    "oil_total_share": "oil of all cylinders, at most",
    "oil_each_share": "oil of each cylinder and side, at most",
    "thrust_share": "supply pressure × bore area of each cylinder, at most",
    "moment_arm_share": "smallest moment arm over the range, at least",
    "transmission_deg": "angle between rocker and coupler, at least",
    "digging": "cylinders whose digging force counts, and the share of it that must remain",
    "pin_box_mm": "how far each pin coordinate may move",
    "pin_boxes_mm": "other boxes for single pins, by cylinder and pin",
    "digging_kN": (
        "digging force at the tool by cylinder, at least: it alone, supply pressure, best angle"
        " (ISO 6015)"
    ),
    "buckling_share": "Euler safety of each rod, at least",
    "buckling_factor": (
        "buckling load over supply pressure × bore area, at least; default: no such limit"
    ),
    "buckling_column": (
        "what buckles: rod, all of the open cylinder as thick as the rod; stepped, barrel and rod"
    ),
    "cylinder_mass_kg": "estimated mass of all cylinders together, at most",
    "barrel_wall_mm": (
        "thickness of the barrel's wall; default: what the supply pressure needs (Lamé)"
    ),
    "speed": "motions at pump flow by name: what one entry names moves together",
    "joint_deg_per_s": "speed of joints, at least; negative: against the joint's direction",
    "joint_mm_per_s": (
        "speed of prismatic joints, at least; negative: against the joint's direction"
    ),
    "cylinder_mm_per_s": "speed of cylinders, at least; negative: retracting",
    "at": "mean: over the joint's range (stroke time); every: at every pose of it",
    "lift": "masses to hold within holding_share, by name",
    "joint_deg": "where joints stand; all of them, or all but two with reach_mm and height_mm",
    "joint_mm": "where prismatic joints stand",
    "reach_mm": "of the mass from the root's vertical axis",
    "height_mm": "of the mass over the root",
    "outline": "outlines by link; pins of cylinders on the link must lie within by their radius",
    "points_mm": "corners x, z in the frame of the link, in order",
    "pin_radius_mm": "of the pins, with what must surround them",
    "clearance": "parts of links that barrels keep clear of, by name",
    "distance_mm": "between barrel and part, at least",
}
IN_SECTION = {  # where a key means something else than in most tables
    "MotorSection": {
        "count": "equal motors in parallel on one joint",
        "hose": "the share of the trapped volume that lies in hoses",
    },
    "PinBoxSection": {
        "base": "of the barrel's pin: how far each of its coordinates may move [mm]",
        "rod_end": "of the rod's pin: how far each of its coordinates may move [mm]",
    },
}
ONE_LINE = {
    "link",
    "at_mm",
    "cap",
    "annulus",
    "a",
    "b",
}  # tables of these keys are written in one line


class Section(BaseModel):
    """A table of the file: no unknown keys, no other types, no NaN."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


class PinSection(Section):
    """A pin, given in the frame of the link that carries it."""

    link: Text
    at_mm: Point


class PayloadSection(Section):
    """A load case; without ``pitch_deg`` it exists at every pose."""

    mass_kg: Mass
    link: Text | None = None
    at_mm: Point | None = None
    pitch_deg: Annotated[list[Angle], Field(min_length=2, max_length=2)] | None = None


class FluidSection(Section):
    """The oil."""

    bulk_modulus_MPa: Annotated[float, Field(gt=0, le=10_000)]
    entrained_air_percent: Annotated[float, Field(ge=0, lt=50)] = 0.0
    density_kg_per_m3: Annotated[float, Field(gt=0, le=5_000)] = 870.0


class SupplySection(Section):
    """The pump."""

    pressure_bar: Pressure
    return_pressure_bar: Annotated[float, Field(ge=0, le=5_000)] = 0.0
    flow_l_per_min: Flow
    pump: Literal["ideal", "flow_limited"] = "ideal"
    cut_off_percent: Annotated[float, Field(gt=0, le=50)] = 5.0
    line_volume_l: Annotated[float, Field(gt=0, le=10_000)] = 5.0


class DeadVolumeSection(Section):
    """Oil that the piston never sweeps, hoses included, all parallel cylinders together."""

    cap: Volume
    annulus: Volume


class HoseSection(Section):
    """The share of the dead volume that lies in hoses, and their wall's modulus."""

    cap_l: Volume = 0.0
    annulus_l: Volume = 0.0
    bulk_modulus_MPa: Annotated[float, Field(gt=0, le=100_000)] = 700.0


class FourBarSection(Section):
    """Rocker and coupler between cylinder and driven link."""

    pivot: PinSection
    rocker_mm: Length
    coupler_mm: Length
    lug: PinSection
    knee: Literal["left", "right"]
    rocker_kg: Mass = 0.0
    coupler_kg: Mass = 0.0


class EdgesSection(Section):
    """Gains of the four metering edges relative to the rated flow."""

    supply_to_cap: Ratio = 1.0
    supply_to_annulus: Ratio = 1.0
    cap_to_return: Ratio = 1.0
    annulus_to_return: Ratio = 1.0


class LoadHoldingSection(Section):
    """A counterbalance or pilot-operated check valve between the 4/3 valve and one chamber."""

    side: Literal["cap", "annulus"]
    setting_bar: Pressure
    pilot_ratio: Annotated[float, Field(ge=0, le=100)]
    opening_range_bar: Pressure = 30.0
    rated_flow_l_per_min: Flow
    rated_drop_bar: Pressure


class ValveSection(Section):
    """The 4/3 valve of an actuator, for all its parallel cylinders together."""

    rated_flow_l_per_min: Flow
    rated_drop_bar: Pressure
    natural_frequency_hz: Annotated[float, Field(gt=0, le=10_000)]
    damping_ratio: Annotated[float, Field(gt=0, le=10)]
    overlap_percent: Annotated[float, Field(gt=-100, lt=100)] = 0.0
    leakage_l_per_min_per_bar: Annotated[float, Field(ge=0, le=1_000)] = 0.0
    tank_leakage_l_per_min_per_bar: Annotated[float, Field(ge=0, le=1_000)] = 0.0
    stroke_time_ms: Annotated[float, Field(gt=0, le=100_000)] | None = None
    relief_bar: Pressure | None = None
    preload_bar: Annotated[float, Field(ge=0, le=5_000)] | None = None
    edges: EdgesSection = EdgesSection()


class FrictionSection(Section):
    """Friction per cylinder."""

    coulomb_N: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    static_N: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    stribeck_velocity_mm_per_s: Annotated[float, Field(gt=0, le=1e6)] = 5.0
    viscous_N_s_per_m: Annotated[float, Field(ge=0, le=1e9)] = 0.0


class CylinderSection(Section):
    """A hydraulic actuator: ``count`` equal cylinders sharing their pins."""

    count: Annotated[int, Field(ge=1, le=16)] = 1
    bore_mm: Length
    rod_mm: Length
    stroke_mm: Length
    closed_length_mm: Length
    dead_volume_l: DeadVolumeSection
    base: PinSection
    rod_end: PinSection | None = None
    four_bar: FourBarSection | None = None
    barrel_kg: Mass = 0.0
    rod_kg: Mass = 0.0
    barrel_wall_mm: Length | None = None
    compliance_m_per_N: Annotated[float, Field(ge=0, le=1)] = 0.0
    hose: HoseSection = HoseSection()
    valve: ValveSection | None = None
    load_holding: LoadHoldingSection | None = None
    friction: FrictionSection = FrictionSection()


class TrappedVolumeSection(Section):
    """Oil between the valve and the motors' pistons, all parallel motors together."""

    a: Annotated[float, Field(gt=0, le=10_000)]
    b: Annotated[float, Field(gt=0, le=10_000)]


class MotorHoseSection(Section):
    """The share of the trapped volume that lies in hoses, and their wall's modulus."""

    a_l: Volume = 0.0
    b_l: Volume = 0.0
    bulk_modulus_MPa: Annotated[float, Field(gt=0, le=100_000)] = 700.0


class MotorFrictionSection(Section):
    """Friction of motors and gear together, at the joint."""

    coulomb_N_m: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    static_N_m: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    stribeck_velocity_deg_per_s: Annotated[float, Field(gt=0, le=1e6)] = 0.5
    viscous_N_m_s_per_rad: Annotated[float, Field(ge=0, le=1e12)] = 0.0


class MotorSection(Section):
    """A hydraulic actuator: ``count`` equal motors that turn a joint through a gear.

    Idle while the joint is frozen.
    """

    joint: Text | None = None
    count: Annotated[int, Field(ge=1, le=16)] = 1
    displacement_cm3: Annotated[float, Field(gt=0, le=1e6)]
    gear_ratio: Annotated[float, Field(gt=0, le=1e6)]
    trapped_volume_l: TrappedVolumeSection
    hose: MotorHoseSection = MotorHoseSection()
    compliance_rad_per_N_m: Annotated[float, Field(ge=0, le=1)] = 0.0
    valve: ValveSection | None = None
    friction: MotorFrictionSection = MotorFrictionSection()


class DiggingSection(Section):
    """Cylinders whose digging force counts, and how much of today's must remain."""

    cylinders: list[Name]
    share: Ratio = 0.95


class PinBoxSection(Section):
    """How far the coordinates of a cylinder's pins may move."""

    base: Distance | None = None
    rod_end: Distance | None = None


class SpeedSection(Section):
    """A motion at pump flow."""

    joint_deg_per_s: dict[Text, Rate] = {}
    joint_mm_per_s: dict[Text, Rate] = {}
    cylinder_mm_per_s: dict[Name, Rate] = {}
    at: Literal["mean", "every"] = "mean"


class LiftSection(Section):
    """A mass to hold at a pose, or at a place."""

    mass_kg: Annotated[float, Field(gt=0, le=1_000_000)]
    link: Text | None = None
    at_mm: Point | None = None
    joint_deg: dict[Text, Angle] = {}
    joint_mm: dict[Text, Coordinate] = {}
    reach_mm: Coordinate | None = None
    height_mm: Coordinate | None = None


class OutlineSection(Section):
    """A polygon in a link's x–z plane, and what pins need within it."""

    points_mm: Polygon
    pin_radius_mm: Distance = 0.0


class ClearanceSection(Section):
    """A polygon in a link's x–z plane, and the cylinders that keep clear of it."""

    cylinders: Annotated[list[Name], Field(min_length=1)]
    link: Text
    points_mm: Polygon
    distance_mm: Distance = 0.0


class RequirementsSection(Section):
    """What a new design must keep, relative to today's machine."""

    end_margin: Annotated[float, Field(ge=0, lt=0.5)] = 0.02
    holding_share: Share = 0.87
    oil_total_share: Ratio = 1.0
    oil_each_share: Ratio = 1.1
    thrust_share: Ratio = 1.1
    moment_arm_share: Ratio = 0.8
    transmission_deg: Annotated[float, Field(ge=0, le=90)] = 20.0
    digging: DiggingSection | None = None
    digging_kN: dict[Name, Annotated[float, Field(gt=0, le=1e6)]] = {}
    buckling_share: Annotated[float, Field(ge=0, le=10)] = 1.0
    buckling_factor: Annotated[float, Field(gt=0, le=1_000)] | None = None
    buckling_column: Literal["rod", "stepped"] = "rod"
    pin_box_mm: Distance | None = None
    pin_boxes_mm: dict[Name, PinBoxSection] = {}
    cylinder_mass_kg: Annotated[float, Field(gt=0, le=1_000_000)] | None = None
    speed: dict[Name, SpeedSection] = {}
    lift: dict[Name, LiftSection] = {}
    outline: dict[Text, OutlineSection] = {}
    clearance: dict[Name, ClearanceSection] = {}


ShareBand = Annotated[
    list[Annotated[float, Field(ge=0.1, le=10)]], Field(min_length=2, max_length=2)
]


class BandsSection(Section):
    """What is not known exactly: lower and upper end, as shares of this file's values."""

    bulk_modulus_share: ShareBand | None = None
    dead_volume_share: ShareBand | None = None
    payload_share: ShareBand | None = None
    link_mass_share: ShareBand | None = None
    entrained_air_percent: (
        Annotated[list[Annotated[float, Field(ge=0, lt=50)]], Field(min_length=2, max_length=2)]
        | None
    ) = None


class MachineSection(Section):
    """The whole file."""

    name: Name
    title: Text | None = None
    urdf: Text
    joints: Annotated[list[Text], Field(min_length=1, max_length=20)]
    frozen: dict[str, Annotated[float, Field(ge=-1e6, le=1e6)]] = {}
    tool: PinSection
    payload: Annotated[dict[Name, PayloadSection], Field(min_length=1)]
    fluid: FluidSection
    supply: SupplySection
    cylinder: Annotated[dict[Name, CylinderSection], Field(min_length=1)]
    motor: dict[Name, MotorSection] = {}
    requirements: RequirementsSection = RequirementsSection()
    bands: BandsSection = BandsSection()


def schema() -> str:
    """The file's JSON Schema for editors, as text: ``machine.schema.json`` in the package is this."""
    document = MachineSection.model_json_schema()
    classes = {kind.__name__: kind for kind in Section.__subclasses__()}
    for name, section in {MachineSection.__name__: document, **document["$defs"]}.items():
        section.pop("title", None)
        special = IN_SECTION.get(name, {})
        for key, value in section.get("properties", {}).items():
            value.pop("title", None)
            if {"type": "null"} in value.get("anyOf", []):  # TOML has no null: the key is left out
                value.update(next(kind for kind in value.pop("anyOf") if kind != {"type": "null"}))
                value.pop("default", None)
            if isinstance(value.get("default"), dict):  # that of a table is in its keys
                value.pop("default")
            unit = _named_unit(key, unwrap(classes[name].model_fields[key].annotation)[0])
            words = [special.get(key, DESCRIPTIONS.get(key, "")), f"[{unit}]" if unit else ""]
            if description := " ".join(word for word in words if word):
                value["description"] = description
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "armdesign machine file",
    }
    return json.dumps({**head, **document}, indent=2, ensure_ascii=False) + "\n"


def unwrap(annotation: Any) -> tuple[Any, list[Any]]:
    """Strip Annotated and optional: (type, constraints)."""
    constraints: list[Any] = []
    while True:
        if get_origin(annotation) is Annotated:
            annotation, *extra = get_args(annotation)
            for item in extra:
                constraints += getattr(item, "metadata", [item])
            continue
        arguments = [a for a in get_args(annotation) if a is not type(None)]
        if type(None) in get_args(annotation) and len(arguments) == 1:
            annotation = arguments[0]
            continue
        return annotation, constraints


def annotation(location: tuple[Any, ...]) -> tuple[Any, list[Any]]:
    """Type and constraints that the schema has at a key path; KeyError where it has none."""
    kind: Any = MachineSection
    constraints: list[Any] = []
    for key in location:
        if isinstance(kind, type) and issubclass(kind, Section):
            field = kind.model_fields[key]
            kind, constraints = unwrap(field.annotation)
            constraints = [*constraints, *field.metadata]
        elif get_origin(kind) in (dict, list):
            kind, constraints = unwrap(get_args(kind)[-1])
        else:
            raise KeyError(key)
    return kind, constraints


def allowed(location: tuple[Any, ...]) -> str:
    """What may stand at a key path, in words."""
    try:
        kind, constraints = annotation(location)
    except KeyError:
        return ""
    if get_origin(kind) is Literal:
        return "one of " + ", ".join(f'"{choice}"' for choice in get_args(kind))
    if kind in (float, int):
        low, high = "(-∞", "∞)"
        for bound in constraints:
            low = (
                f"({bound.gt:g}"
                if isinstance(bound, Gt)
                else f"[{bound.ge:g}"
                if isinstance(bound, Ge)
                else low
            )
            high = (
                f"{bound.lt:g})"
                if isinstance(bound, Lt)
                else f"{bound.le:g}]"
                if isinstance(bound, Le)
                else high
            )
        return (
            f"{'a whole number' if kind is int else 'a number'} in {low},"
            f" {high}{unit_of(location)}"
        )
    if get_origin(kind) is list:
        least = next((c.min_length for c in constraints if isinstance(c, MinLen)), 0)
        exact = any(isinstance(c, MaxLen) and c.max_length == least for c in constraints)
        words = (
            f"{least} values"
            if exact
            else f"at least {least}"
            if least
            else "any number of values"
        )
        return f"a list of {words}, each {allowed((*location, 0))}"
    if kind is str:
        return (
            "a text of letters, digits, _ and -"
            if (kind, constraints) == unwrap(Name)
            else "a text"
        )
    if get_origin(kind) is dict:
        return "a table of named entries (names of letters, digits, _ and -)"
    required = [name for name, field in kind.model_fields.items() if field.is_required()]
    return f"a table with {', '.join(required)}" if required else "a table"


def bounds(location: tuple[Any, ...]) -> tuple[float, float]:
    """Least and largest number that may stand at a key path."""
    low, high = -math.inf, math.inf
    for bound in annotation(location)[1]:
        low = bound.gt if isinstance(bound, Gt) else bound.ge if isinstance(bound, Ge) else low  # type: ignore[assignment]
        high = bound.lt if isinstance(bound, Lt) else bound.le if isinstance(bound, Le) else high  # type: ignore[assignment]
    return low, high


def unit_of(location: tuple[Any, ...]) -> str:
    """Unit of a number, with a space before it: its key names it, or else that of the list or table that it is in."""
    kind: Any = MachineSection
    unit = ""
    for key in location:
        if isinstance(kind, type) and issubclass(kind, Section) and key in kind.model_fields:
            kind, _ = unwrap(kind.model_fields[key].annotation)
            unit = _named_unit(key, kind) or unit
        elif get_origin(kind) in (
            dict,
            list,
        ):  # the names of entries are the author's: a joint may be called arm_mm
            kind, _ = unwrap(get_args(kind)[-1])
    return f" {unit}" if unit else ""


def _named_unit(key: str, kind: Any) -> str:
    """The unit that a key names; none for a table whose own keys name theirs, such as four_bar."""
    found = UNIT_END.search(key)
    fields = kind.model_fields if isinstance(kind, type) and issubclass(kind, Section) else {}
    return UNITS[found[1]] if found and not any(map(UNIT_END.search, fields)) else ""
