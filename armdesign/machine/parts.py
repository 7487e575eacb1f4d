"""The parts of a machine from the tables of its file; only here do workshop units become SI."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeAlias, TypeVar

from armdesign.hydraulics.actuator import SIDES, Cylinder, Motor
from armdesign.hydraulics.fluid import Fluid, Supply
from armdesign.hydraulics.friction import NO_FRICTION, Friction
from armdesign.hydraulics.valve import Edges, LoadHolding, Valve
from armdesign.machine.file.schema import (
    CylinderSection,
    FluidSection,
    LoadHoldingSection,
    MachineSection,
    MotorSection,
    PayloadSection,
    PinSection,
    SpringSection,
    SupplySection,
    ValveSection,
)
from armdesign.machine.file.section import Section
from armdesign.machine.load_case import LoadCase
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.linkage.base import Linkage, Pin
from armdesign.mechanism.linkage.kinds import KINDS
from armdesign.mechanism.spring import Spring
from armdesign.units import MPa, bar, cm3, deg, l_per_min, litre, mm, ms

A = TypeVar("A", Cylinder, Motor)
Pairs: TypeAlias = tuple[tuple[Cylinder, Linkage], ...]


def load_cases(section: MachineSection) -> tuple[LoadCase, ...]:
    """Load cases in the order of the file."""
    return tuple(_load_case(name, table) for name, table in section.payload.items())


def _load_case(name: str, section: PayloadSection) -> LoadCase:
    x, y, z = (value * mm for value in section.at_mm or (0.0, 0.0, 0.0))
    pitch = None
    if section.pitch_deg is not None:
        pitch = (section.pitch_deg[0] * deg, section.pitch_deg[1] * deg)
    return LoadCase(name=name, mass=section.mass_kg, link=section.link, at=(x, y, z), pitch=pitch)


def fluid(section: FluidSection) -> Fluid:
    """The oil."""
    return Fluid(
        bulk_modulus=section.bulk_modulus_MPa * MPa,
        air=section.entrained_air_percent / 100,
        density=section.density_kg_per_m3,
    )


def supply(section: SupplySection) -> Supply:
    """The pump."""
    return Supply(
        pressure=section.pressure_bar * bar,
        return_pressure=section.return_pressure_bar * bar,
        flow=section.flow_l_per_min * l_per_min,
        flow_limited=section.pump == "flow_limited",
        cut_off=section.cut_off_percent / 100,
        line_volume=section.line_volume_l * litre,
    )


def coordinates(section: MachineSection) -> tuple[Any, ...]:
    """Keys of a machine file on which an arm depends: links, joints, where others stand, tool."""
    standing = [(spring.joint, spring.at) for spring in springs_of(section)]
    tool = section.tool.link
    return section.urdf, section.links, section.joints, section.frozen, standing, tool


def arm(section: MachineSection, urdf_text: str, source: str) -> Arm:
    """The arm of a URDF or of ``[links]``, whose numbers have been checked in the file."""
    whence, of_links = (source, True) if section.links else (str(section.urdf), False)
    return Arm(
        urdf_text,
        section.joints,
        section.frozen,
        whence,
        springs_of(section),
        of_links=of_links,
        tool=section.tool.link,
    )


def springs_of(section: MachineSection) -> tuple[Spring, ...]:
    """Springs in the order of the file."""
    springs = (_spring(name, table) for name, table in section.spring.items())
    return tuple(springs if section.damped else (replace(s, damping_ratio=0.0) for s in springs))


def _spring(name: str, section: SpringSection) -> Spring:
    turning, sliding = section.stiffness_N_m_per_rad, section.stiffness_N_per_m
    turns, stiffness = turning is not None, sliding if turning is None else turning
    return Spring(
        name=name,
        joint=section.joint,
        revolute=turns,
        stiffness=math.nan if stiffness is None else stiffness,
        damping_ratio=section.damping_ratio,
        at=(section.at_deg or 0.0) * deg if turns else (section.at_mm or 0.0) * mm,
    )


def pin(section: PinSection) -> Pin:
    """A pin [m]."""
    x, y, z = (value * mm for value in section.at_mm)
    return Pin(link=section.link, at=(x, y, z))


def linkage(section: CylinderSection, arm: Arm) -> Linkage:
    """The linkage of a cylinder."""
    kind, table = _kind(section)
    own = {kind.key: pin(table)} if isinstance(table, PinSection) else _lengths(table)
    return kind(base=pin(section.base), arm=arm, **own)


def _kind(section: CylinderSection) -> tuple[type[Linkage], Section]:
    """The kind of a cylinder's linkage, and its table."""
    tables = ((kind, getattr(section, kind.key)) for kind in KINDS)
    return next((kind, table) for kind, table in tables if table is not None)


def _lengths(section: Section) -> dict[str, Any]:
    """A linkage's table without its masses: pins, lengths [m] and words by name."""
    values: dict[str, Any] = {}
    for key, value in section:
        if isinstance(value, PinSection):
            values[key] = pin(value)
        elif key.endswith("_mm"):
            values[key.removesuffix("_mm")] = value * mm
        elif not key.endswith("_kg"):
            values[key] = value
    return values


def pin_sections(section: CylinderSection) -> dict[str, PinSection]:
    """Every pin of a cylinder by its key path, of all linkages that its table gives."""
    tables: dict[str, Any] = {"base": section.base}
    for kind in KINDS:
        if (table := getattr(section, kind.key)) is not None:
            tables |= {kind.key: table, **{f"{kind.key}.{key}": value for key, value in table}}
    return {key: value for key, value in tables.items() if isinstance(value, PinSection)}


def _valve(section: ValveSection) -> Valve:
    return Valve(
        rated_flow=section.rated_flow_l_per_min * l_per_min,
        rated_drop=section.rated_drop_bar * bar,
        natural_frequency=section.natural_frequency_hz,
        damping_ratio=section.damping_ratio,
        overlap=section.overlap_percent / 100,
        leakage=section.leakage_l_per_min_per_bar * l_per_min / bar,
        tank_leakage=section.tank_leakage_l_per_min_per_bar * l_per_min / bar,
        fastest=math.inf if section.stroke_time_ms is None else 1 / (section.stroke_time_ms * ms),
        relief=None if section.relief_bar is None else section.relief_bar * bar,
        preload=None if section.preload_bar is None else section.preload_bar * bar,
        edges=Edges(**section.edges.model_dump()),
    )


def _load_holding(section: LoadHoldingSection) -> LoadHolding:
    return LoadHolding(
        side=section.side,
        setting=section.setting_bar * bar,
        pilot_ratio=section.pilot_ratio,
        opening_range=section.opening_range_bar * bar,
        rated_flow=section.rated_flow_l_per_min * l_per_min,
        rated_drop=section.rated_drop_bar * bar,
    )


def cylinders(tables: Mapping[str, CylinderSection], damped: bool) -> tuple[Cylinder, ...]:
    """The hydraulics of cylinders, with valves; friction and leakage too if ``damped``."""
    given = (_cylinder(name, table) for name, table in tables.items())
    return tuple(given if damped else map(_without_losses, given))


def _without_losses(actuator: A) -> A:
    valve = actuator.valve and replace(actuator.valve, leakage=0.0, tank_leakage=0.0)
    return replace(actuator, valve=valve, friction=NO_FRICTION)


def _common(
    name: str, section: CylinderSection | MotorSection, volumes: Section
) -> dict[str, Any]:
    """The fields of cylinders and motors alike, with the ``volumes`` [l] of their two sides."""
    fields: dict[str, Any] = {"name": name, "count": section.count}
    for side, key in zip(SIDES, type(volumes).model_fields, strict=True):
        fields[f"{side}_dead_volume"] = getattr(volumes, key) * litre
        fields[f"{side}_hose_volume"] = getattr(section.hose, f"{key}_l") * litre
    valve = _valve(section.valve) if section.valve else None
    return fields | {"hose_modulus": section.hose.bulk_modulus_MPa * MPa, "valve": valve}


def _cylinder(name: str, section: CylinderSection) -> Cylinder:
    friction, (kind, table) = section.friction, _kind(section)
    return Cylinder(
        **_common(name, section, section.dead_volume_l),
        bore=section.bore_mm * mm,
        rod=section.rod_mm * mm,
        stroke=section.stroke_mm * mm,
        closed_length=section.closed_length_mm * mm,
        compliance=section.compliance_m_per_N,
        barrel_mass=section.barrel_kg,
        rod_mass=section.rod_kg,
        barrel_wall=None if section.barrel_wall_mm is None else section.barrel_wall_mm * mm,
        linkage_masses=tuple((bar, getattr(table, f"{bar}_kg")) for bar in kind.bar_names),
        load_holding=_load_holding(section.load_holding) if section.load_holding else None,
        friction=Friction(
            coulomb=friction.coulomb_N,
            static=friction.static_N or friction.coulomb_N,
            stribeck_velocity=friction.stribeck_velocity_mm_per_s * mm,
            viscous=friction.viscous_N_s_per_m,
        ),
    )


def cylinders_with_linkages(section: MachineSection, arm: Arm) -> tuple[Pairs, Pairs]:
    """Cylinders with their linkages: those that can move, and idle ones."""
    linkages = [linkage(table, arm) for table in section.cylinder.values()]
    pairs = tuple(zip(cylinders(section.cylinder, section.damped), linkages, strict=True))
    idle = [not of.joints and bool(frozen_joints(of)) for of in linkages]
    moving, still = (
        tuple(pair for pair, rests in zip(pairs, idle, strict=True) if rests == which)
        for which in (False, True)
    )
    return moving, still


def frozen_joints(own: Linkage) -> list[str]:
    """Frozen joints between the pins of a linkage."""
    frozen = own.arm.frozen_between(at.link for at in own.pins)
    return sorted(frozen, key=own.arm.movable_joints.index)


def motors(section: MachineSection) -> tuple[Motor, ...]:
    """Motors of the joints that are coordinates; motors of frozen joints stand still."""
    given = (_motor(name, motor) for name, motor in section.motor.items())
    at_work = (motor for motor in given if motor.joint in section.joints)
    return tuple(at_work if section.damped else map(_without_losses, at_work))


def _motor(name: str, section: MotorSection) -> Motor:
    friction, count = section.friction, section.count
    return Motor(
        **_common(name, section, section.trapped_volume_l),
        joint=section.joint or name,
        displacement=section.displacement_cm3 * cm3,
        gear_ratio=section.gear_ratio,
        compliance=section.compliance_rad_per_N_m,
        friction=Friction(  # of one motor: an actuator multiplies it by their count
            coulomb=friction.coulomb_N_m / count,
            static=(friction.static_N_m or friction.coulomb_N_m) / count,
            stribeck_velocity=friction.stribeck_velocity_deg_per_s * deg,
            viscous=friction.viscous_N_m_s_per_rad / count,
        ),
    )
