"""The JSON Schema of the machine file, which editors show and check while a file is written."""

from __future__ import annotations

import json
from typing import Any

from armdesign.machine.file.key_paths import named_unit, unwrap
from armdesign.machine.file.schema import BY_ACTUATOR, MachineSection
from armdesign.machine.file.section import Section

DESCRIPTIONS = {  # what an editor shows at a key; its unit is added
    "name": "short name: letters, digits, _ and -",
    "title": "name for people",
    "urdf": "the URDF, relative to this file; or give links",
    "links": "the rigid links by name, in place of a URDF; one of them, the root, has no parent",
    "joints": "the coordinates, in this order; every other joint is frozen",
    "frozen": "values of frozen joints [rad or m]; 0 where none is given",
    "damped": "false: friction and leakage of all actuators, and damping of springs, are left out",
    "tool": "the point whose place is reported",
    "payload": "load cases by name; the worst one counts",
    "fluid": "the oil",
    "density_kg_per_m3": "density of the oil; told by check, changes no result",
    "supply": "the pump",
    "pressure_bar": "relief pressure: the most that the pump gives",
    "return_pressure_bar": "pressure behind the valves on the way to the tank",
    "mass_kg": "mass of the load",
    "cylinder": "hydraulic actuators by name",
    "cylinders": "names of the cylinders",
    "link": "link of the URDF or of links",
    "at_mm": "x, y, z in the frame of the link",
    "pitch_deg": "the case exists only while the link's x axis has this pitch, up from forward",
    "bulk_modulus_MPa": "bulk modulus: of fluid, the oil without air; of a hose, oil and hose",
    "entrained_air_percent": "air in the oil: its volume at atmospheric pressure over the oil's",
    "flow_l_per_min": "largest flow of the pump",
    "count": "equal cylinders in parallel that share their pins",
    "bore_mm": "inner diameter of the barrel",
    "rod_mm": "diameter of the rod",
    "closed_length_mm": "pin to pin, rod in",
    "stroke_mm": "way of the piston from end to end",
    "dead_volume_l": "oil that the piston never sweeps, hoses included",
    "cap": "on the side of the piston without rod",
    "annulus": "on the side of the rod",
    "base": "pin of the barrel",
    "rod_end": "pin of the rod; or give four_bar",
    "four_bar": "rocker and coupler that the rod end drives",
    "pivot": "pin of the rocker",
    "lug": "pin of the coupler on the driven link",
    "rocker_mm": "pivot to knee",
    "coupler_mm": "knee to lug",
    "knee": "side of the line from pivot to lug, seen with x right and z up",
    "rocker_kg": "mass of the rocker",
    "coupler_kg": "mass of the coupler",
    "barrel_kg": "mass of the barrel",
    "rod_kg": "mass of the rod",
    "compliance_m_per_N": "compliance of pins, brackets and links in series",
    "hose": "the share of the dead volume that lies in hoses",
    "motor": "hydraulic motors by name, on joints that turn, with limits or without end",
    "spring": "structure that yields: joints that no actuator drives, by name",
    "stiffness_N_m_per_rad": "stiffness of a joint that turns",
    "stiffness_N_per_m": "stiffness of a joint that slides",
    "at_deg": "where the joint stands at rest: its preload is what gravity needs there",
    "joint": "joint that the motor turns; default: the one of the motor's name",
    "displacement_cm3": "oil per turn of one motor",
    "gear_ratio": "turns of a motor per turn of the joint",
    "trapped_volume_l": "oil between valve and pistons, hoses included; a drives forward",
    "a": "on the side that drives the joint forward",
    "b": "on the side that drives the joint backward",
    "cap_l": "oil in the hoses of the cap side",
    "annulus_l": "oil in the hoses of the rod side",
    "a_l": "oil in the hoses of side a",
    "b_l": "oil in the hoses of side b",
    "compliance_rad_per_N_m": "compliance of gear and mounting in series, at the joint",
    "valve": "one valve for all parallel cylinders or motors together",
    "rated_flow_l_per_min": "flow through one metering edge, fully open, at the rated drop",
    "rated_drop_bar": "pressure drop of one metering edge at the rated flow",
    "overlap_percent": "of full spool stroke; negative: underlap",
    "leakage_l_per_min_per_bar": "leakage across the piston",
    "tank_leakage_l_per_min_per_bar": "leakage from each chamber to the tank",
    "stroke_time_ms": "least time of the spool from its middle to its end; default: no limit",
    "relief_bar": "where the port reliefs open; the lower of it and supply pressure is the"
    " available pressure; default: 1.1 × supply pressure",
    "preload_bar": "of the chamber without load while the valve is shut and tight; default: return"
    " pressure",
    "natural_frequency_hz": "natural frequency of the spool",
    "damping_ratio": "damping ratio of the spool",
    "supply_to_cap": "of the edge that fills the cap side, of a motor side a",
    "supply_to_annulus": "of the edge that fills the rod side, of a motor side b",
    "cap_to_return": "of the edge that empties the cap side, of a motor side a",
    "annulus_to_return": "of the edge that empties the rod side, of a motor side b",
    "edges": "gains of the four metering edges, relative to the rated flow",
    "load_holding": "counterbalance or pilot-operated check valve on one chamber",
    "side": "the chamber that the valve holds",
    "setting_bar": "chamber pressure that opens the valve without pilot pressure",
    "pilot_ratio": "how many times the pressure of the other chamber counts in opening the valve",
    "opening_range_bar": "pressure rise from beginning to open to fully open",
    "pump": "flow_limited: gives no more than its flow; ideal: holds its pressure",
    "cut_off_percent": "last share of its pressure in which a flow-limited pump cuts off its flow",
    "line_volume_l": "oil between a flow-limited pump and its valves",
    "friction": "friction of the actuator; default: none",
    "coulomb_N": "dry friction while the piston moves",
    "static_N": "friction at which the piston begins to move; default: coulomb_N",
    "stribeck_velocity_mm_per_s": "speed in whose range friction falls from static to dry",
    "viscous_N_s_per_m": "friction per speed",
    "coulomb_N_m": "dry friction while the joint turns",
    "static_N_m": "friction at which the joint begins to turn; default: coulomb_N_m",
    "stribeck_velocity_deg_per_s": "speed in whose range friction falls from static to dry",
    "viscous_N_m_s_per_rad": "friction per speed",
    "bands": "what is not known exactly: [lower, upper] as shares of this file's values",
    "structure": "series compliance of each actuator over its oil's, without air, at mid"
    " stroke: 0 rigid, 1 as soft as that oil",
    "structures": "the same of single actuators by name, which come before structure",
    "spring_stiffness_share": "of every spring's stiffness",
    "bulk_modulus_share": "of the oil's bulk modulus without air",
    "dead_volume_share": "of every chamber's dead volume",
    "payload_share": "of the mass of every load case",
    "link_mass_share": "of mass and inertia of what each joint moves",
    "tolerances": "how far single machines may lie from this file's values, either way",
    "lift_chart": "grid on which the lift chart says what the machine lifts (ISO 10567)",
    "step_m": "of the grid, in reach and height; default: about a sixth of the reach, round, or"
    " finer where fewer than 6 places are within reach",
    "from_m": "least reach of the grid; default: two steps",
    "stability": "what stands still while the arm moves, and where the machine tips over",
    "front_mm": "tipping line ahead of the slew axis, where the arm points, from it",
    "rear_mm": "tipping line behind the slew axis, seen from where the arm points, from it",
    "lift_share": "of today's lift at every point of the lift chart, at least; 0: not asked",
    "requirements": "what a new design must keep, relative to today's machine",
    "end_margin": "share of the stroke that stays free at both ends",
    "holding_share": "static force over what supply against return pressure gives",
    "oil_total_share": "oil of all cylinders, at most",
    "oil_each_share": "oil of each cylinder and side, at most",
    "thrust_share": "available pressure × bore area of each cylinder, at most",
    "moment_arm_share": "smallest moment arm over the range, at least",
    "torque_share": "largest torque of each actuator in each direction, at least",
    "end_torque_share": (
        "torque of each actuator in each direction at both ends of the range, at least"
    ),
    "transmission_deg": "angle between rocker and coupler, at least",
    "share": "of today's digging torque, at least",
    "digging": "cylinders whose digging force counts, and the share of it that must remain",
    "pin_box_mm": "how far each pin coordinate may move",
    "pin_boxes_mm": "other boxes for single pins, by cylinder and pin",
    "digging_kN": "digging force at the tool by cylinder, at least: it alone, available pressure,"
    " best angle (ISO 6015)",
    "buckling_share": "Euler safety of each rod, at least",
    "buckling_factor": "buckling load over available pressure × bore area, at least; default: no"
    " such limit",
    "buckling_column": "what buckles: rod, all of the open cylinder as thick as the rod; stepped,"
    " barrel and rod",
    "cylinder_mass_kg": "estimated mass of all cylinders together, at most",
    "catalogue": "bores and rods of a new design; pins then on whole mm, strokes on 5 mm",
    "barrel_wall_mm": "thickness of the barrel's wall; default: what the supply pressure needs"
    " (Lamé)",
    "speed": "motions at pump flow by name: what one entry names moves together",
    "joint_deg_per_s": "speed of joints, at least; negative: against the joint's direction",
    "joint_mm_per_s": "speed of prismatic joints, at least; negative: against the joint's"
    " direction",
    "cylinder_mm_per_s": "speed of cylinders, at least; negative: retracting",
    "at": "mean: over the joint's range (stroke time); every: at every pose of it",
    "lift": "masses to hold within holding_share, by name",
    "joint_deg": "positions of joints: of all, or all but two with reach_mm and height_mm",
    "joint_mm": "positions of prismatic joints",
    "reach_mm": "distance of the mass from the root's vertical axis",
    "height_mm": "height of the mass over the root",
    "outline": "outlines by link; pins of cylinders on the link must lie within by their radius",
    "points_mm": "corners x, z in the frame of the link, in order",
    "pin_radius_mm": "radius of the pins, with the metal that must surround them",
    "clearance": "parts of links that barrels keep clear of, by name",
    "distance_mm": "distance between barrel and part, at least",
}
IN_SECTION = {  # where a key means something else than in most tables
    "LinkSection": {
        "parent": "the link that carries it by a joint; none: the root, which stands still",
        "type": "of its joint: revolute (default), prismatic, continuous (turns without end), or"
        " fixed",
        "joint": "name of its joint; default: the link's own name",
        "at_mm": "origin of its frame in the parent's frame, which is where its joint is; default:"
        " the end of the parent's length_mm",
        "turn_deg": "roll, pitch, yaw of its frame in the parent's, joint at 0; default: none",
        "axis": "of its joint in its own frame; default: [0, -1, 0], positive raises, of a"
        " prismatic joint [1, 0, 0]",
        "limits_deg": "lower, upper of a joint that turns; what the strokes allow may be less",
        "limits_mm": "lower, upper of a joint that slides; what the strokes allow may be less",
        "length_mm": "from its joint along x to the next one, or to the tip",
        "mass_kg": "of the link, all that is welded and bolted to it included; default: none",
        "centre_mm": "centre of mass in its frame; default: the middle of length_mm",
        "inertia_kg_m2": "xx, yy, zz, and xy, xz, yz where they are not 0, about the centre of"
        " mass, axes parallel to its frame; default: of box_mm, else of a slender bar along x as"
        " long as length_mm",
        "box_mm": "edges along x, y, z of a uniform box around the centre of mass, whose inertia"
        " the link then has",
    },
    "TolerancesSection": {
        "distribution": "uniform: within the widths; normal: the width is two deviations",
        "least_hz": "worst frequency that a machine must reach; default: this file's own",
        "pin_mm": "of every coordinate of a cylinder's pins in their link's plane, either way",
        "bar_mm": "of rockers and couplers of four-bars, either way",
        "payload_percent": "of the mass of every load case, either way",
        "link_mass_percent": "of mass and inertia of what each joint moves, either way",
        "cylinder_mass_percent": "of barrels, rods and bars of four-bars, either way",
        "bulk_modulus_percent": "of the oil's, either way",
        "entrained_air_percent": "by volume, more or less air than the file says, not below none",
        "dead_volume_percent": "of every chamber, either way",
        "compliance_percent": "of the structure in series with each actuator, either way",
        "spring_stiffness_percent": "of every spring, either way",
        "keys": "of single numbers by key path in quotes, in their unit, either way",
    },
    "BandsSection": {"entrained_air_percent": "its volume at atmospheric pressure over the oil's"},
    "LoadHoldingSection": {
        "rated_flow_l_per_min": "flow through the open valve at the rated drop",
        "rated_drop_bar": "pressure drop of the open valve at the rated flow",
    },
    "LiftSection": {"mass_kg": "mass to hold"},
    "ClearanceSection": {"cylinders": "cylinders whose barrels keep clear of the part"},
    "DiggingSection": {"cylinders": "cylinders whose digging force counts"},
    "LiftChartSection": {
        "link": "that carries the load; default: by the pin of the tool's link, or the tool",
        "joints": (
            "the two that bring the point to its place, others stand at the middle of their range;"
            " default: the first two that move its height, slewing apart"
        ),
    },
    "StabilitySection": {
        "mass_kg": "of all that the arm's joints do not move, upper structure included",
        "at_mm": "centre of that mass: ahead of the slew axis, where the arm points, which alone"
        " counts, aside of it, and over the ground",
    },
    "MotorSection": {
        "count": "equal motors in parallel on one joint",
        "hose": "the share of the trapped volume that lies in hoses",
    },
    "SpringSection": {
        "joint": "passive joint, which is none of joints",
        "damping_ratio": "of the joint alone, all others locked",
        "at_mm": "where the joint stands at rest: its preload is what gravity needs there",
    },
    "PinBoxSection": {
        "base": "of the barrel's pin: how far each of its coordinates may move [mm]",
        "rod_end": "of the rod's pin: how far each of its coordinates may move [mm]",
    },
}

# numbers that could be of one of several parallel actuators, or of all of them together
EACH = {
    "CylinderSection": "bore_mm rod_mm barrel_kg rod_kg barrel_wall_mm",
    "FrictionSection": "coulomb_N static_N viscous_N_s_per_m",
    "MotorSection": "displacement_cm3",
}
TOGETHER = {
    "CylinderSection": "dead_volume_l compliance_m_per_N",
    "DeadVolumeSection": "cap annulus",
    "HoseSection": "cap_l annulus_l",
    "FourBarSection": "rocker_kg coupler_kg",
    "ValveSection": (
        "rated_flow_l_per_min leakage_l_per_min_per_bar tank_leakage_l_per_min_per_bar"
    ),
    "LoadHoldingSection": "rated_flow_l_per_min",
    "MotorSection": "trapped_volume_l compliance_rad_per_N_m",
    "TrappedVolumeSection": "a b",
    "MotorHoseSection": "a_l b_l",
    "MotorFrictionSection": "coulomb_N_m static_N_m viscous_N_m_s_per_rad",
}


def of_how_many(section: str, key: str) -> str:
    """Whether a number is of each parallel actuator or of all together; empty if it is neither."""
    if key in EACH.get(section, "").split():
        return "each"
    return "all parallel ones together" if key in TOGETHER.get(section, "").split() else ""


def meaning(section: str, key: str) -> str:
    """Meaning of a key of a section of the schema, in words."""
    return IN_SECTION.get(section, {}).get(key, DESCRIPTIONS.get(key, ""))


def json_schema() -> str:
    """The JSON Schema as text: ``machine.schema.json`` in the package is this."""
    document = MachineSection.model_json_schema()
    classes = {kind.__name__: kind for kind in Section.__subclasses__()}
    for name, section in {MachineSection.__name__: document, **document["$defs"]}.items():
        section.pop("title", None)
        for key, value in section.get("properties", {}).items():
            unit = named_unit(key, unwrap(classes[name].model_fields[key].annotation)[0])
            words = "; ".join(filter(None, [meaning(name, key), of_how_many(name, key)]))
            words += "; or a table by actuator, with a default" if key in BY_ACTUATOR else ""
            _describe(value, f"{words} {unit and f'[{unit}]'}".strip())
    draft = "https://json-schema.org/draft/2020-12/schema"
    head = {"$schema": draft, "title": "armdesign machine file"}
    return json.dumps({**head, **document}, indent=2, ensure_ascii=False) + "\n"


def _describe(value: dict[str, Any], description: str) -> None:
    """Give a key its description, and take out what TOML has not or the key's own table says."""
    value.pop("title", None)
    if {"type": "null"} in value.get("anyOf", []):  # TOML has no null: the key is left out
        value.update(next(kind for kind in value.pop("anyOf") if kind != {"type": "null"}))
        value.pop("default", None)
    if isinstance(value.get("default"), dict):  # the defaults of a table are in its keys
        value.pop("default")
    if description:
        value["description"] = description
