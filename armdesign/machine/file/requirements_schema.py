"""The schema of ``[requirements]``: what a new design must keep."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from armdesign.machine.file.schema_types import (
    Angle,
    Coordinate,
    Distance,
    Name,
    Point,
    Polygon,
    Rate,
    Ratio,
    Section,
    Share,
    Text,
)


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
