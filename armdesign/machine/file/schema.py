"""The schema of the machine file: its tables and keys, each with its unit in the name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator

from armdesign.machine.file.links import LinkSection
from armdesign.machine.file.section import (
    Angle,
    Coordinate,
    Distance,
    Flow,
    Length,
    Mass,
    Name,
    Pair,
    Point,
    Polygon,
    Pressure,
    Rate,
    Ratio,
    Section,
    Share,
    Text,
    Volume,
)
from armdesign.machine.file.unquoted_keys import joined_keys

Least = Annotated[float, Field(ge=0, le=10)]  # share that is kept; 0: no such limit

Number = TypeVar("Number")
FORMS = NUMBER, TABLE = "[number]", "[table]"  # of a key that may be either
DEFAULT = "default"  # of a table by actuator: the share of those that it does not name


def _form(value: Any) -> str:
    return TABLE if isinstance(value, Mapping) else NUMBER


# one number for all actuators; or a table by actuator, whose default is the number of the others
ByActuator = Annotated[
    Annotated[Number, Tag(NUMBER)] | Annotated[dict[Name, Number], Tag(TABLE)],
    Discriminator(_form),
]
Shares: TypeAlias = float | Mapping[str, float]


def share_of(shares: Shares, actuator: str) -> float:
    """The share of one actuator: its own where a table gives it, else the common one."""
    if isinstance(shares, Mapping):
        return float(shares.get(actuator, shares[DEFAULT]))
    return shares


# ------------------------------------------------------------------------------------ requirements


class DiggingSection(Section):
    """Cylinders whose digging force counts, and how much of today's must remain."""

    cylinders: list[Name]
    share: Ratio = 0.95


class PinBoxSection(Section):
    """Boxes within which the coordinates of a cylinder's pins may move."""

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


BY_ACTUATOR = (  # keys whose shares may differ from actuator to actuator
    "holding_share",
    "oil_each_share",
    "thrust_share",
    "moment_arm_share",
    "lift_share",
    "torque_share",
    "end_torque_share",
    "buckling_share",
)


class RequirementsSection(Section):
    """Requirements on a new design, relative to today's machine."""

    end_margin: Annotated[float, Field(ge=0, lt=0.5)] = 0.02
    holding_share: ByActuator[Share] = 0.87
    oil_total_share: Ratio = 1.0
    oil_each_share: ByActuator[Ratio] = 1.1
    thrust_share: ByActuator[Ratio] = 1.1
    moment_arm_share: ByActuator[Ratio] = 0.8
    lift_share: ByActuator[Least] = 0.9
    torque_share: ByActuator[Least] = 0.95
    end_torque_share: ByActuator[Least] = 0.8
    transmission_deg: Annotated[float, Field(ge=0, le=90)] = 20.0
    digging: DiggingSection | None = None
    digging_kN: dict[Name, Annotated[float, Field(gt=0, le=1e6)]] = {}
    buckling_share: ByActuator[Least] = 1.0
    buckling_factor: Annotated[float, Field(gt=0, le=1_000)] | None = None
    buckling_column: Literal["rod", "stepped"] = "rod"
    pin_box_mm: Distance | None = None
    pin_boxes_mm: dict[Name, PinBoxSection] = {}
    cylinder_mass_kg: Annotated[float, Field(gt=0, le=1_000_000)] | None = None
    catalogue: Literal["iso", "5mm"] | None = None
    speed: dict[Name, SpeedSection] = {}
    lift: Annotated[dict[Name, LiftSection], Field(max_length=100)] = {}
    outline: dict[Text, OutlineSection] = {}
    clearance: dict[Name, ClearanceSection] = {}

    @field_validator(*BY_ACTUATOR)
    @classmethod
    def _with_default(cls, value: Shares, info: ValidationInfo) -> Shares:
        default = cls.model_fields[str(info.field_name)].default
        return {DEFAULT: default, **value} if isinstance(value, Mapping) else value


# ----------------------------------------------------------------------------------------- machine


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
    pump: Literal["ideal", "flow_limited"] = "flow_limited"
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


Stiffness = Annotated[float, Field(gt=0, le=1e15)]


class SpringSection(Section):
    """A passive joint: one that no actuator drives, on which structure yields."""

    joint: Text
    stiffness_N_m_per_rad: Stiffness | None = None
    stiffness_N_per_m: Stiffness | None = None
    damping_ratio: Annotated[float, Field(ge=0, le=10)] = 0.0
    at_deg: Angle | None = None
    at_mm: Coordinate | None = None


ShareBand = Pair[Annotated[float, Field(ge=0.1, le=10)]]


class BandsSection(Section):
    """Bands of values that are not known exactly: their ends, as shares of this file's values.

    ``structure``: series compliance of each actuator over its oil's, without air, at mid stroke;
    ``structures``: the same of single actuators.
    """

    structure: Pair[Annotated[float, Field(ge=0, le=10)]] | None = None
    structures: dict[Name, Pair[Annotated[float, Field(ge=0, le=100)]]] = {}
    spring_stiffness_share: ShareBand | None = None
    bulk_modulus_share: ShareBand | None = None
    dead_volume_share: ShareBand | None = None
    payload_share: ShareBand | None = None
    link_mass_share: ShareBand | None = None
    entrained_air_percent: Pair[Annotated[float, Field(ge=0, lt=50)]] | None = None


# more are refused where it is known which move the point; editors know the number
AtMostTwo = Field(min_length=1, json_schema_extra={"maxItems": 2})


class LiftChartSection(Section):
    """The grid of reach and height on which the lift chart says what the machine lifts."""

    link: Text | None = None
    at_mm: Point | None = None
    joints: Annotated[list[Text], AtMostTwo] | None = None
    step_m: Annotated[float, Field(gt=0, le=100)] | None = None
    from_m: Annotated[float, Field(ge=0, le=1_000)] | None = None


class StabilitySection(Section):
    """The part that stands still while the arm moves, and the lines about which it tips."""

    mass_kg: Mass
    at_mm: Point
    front_mm: Distance
    rear_mm: Distance


Width = Annotated[float, Field(gt=0, le=100_000)]
Percent = Annotated[float, Field(gt=0, lt=100)]


class TolerancesSection(Section):
    """Widths by which single machines may differ from this file's values, either way.

    ``keys``: of single numbers by key path, in their unit.
    """

    distribution: Literal["uniform", "normal"] = "uniform"
    least_hz: Annotated[float, Field(gt=0, le=1_000)] | None = None
    pin_mm: Width | None = None
    bar_mm: Width | None = None
    payload_percent: Percent | None = None
    link_mass_percent: Percent | None = None
    cylinder_mass_percent: Percent | None = None
    bulk_modulus_percent: Percent | None = None
    entrained_air_percent: Percent | None = None
    dead_volume_percent: Percent | None = None
    compliance_percent: Percent | None = None
    spring_stiffness_percent: Percent | None = None
    keys: dict[Text, Width] = {}

    _unquoted = field_validator("keys", mode="before")(joined_keys)


class MachineSection(Section):
    """The whole file."""

    name: Name
    title: Text | None = None
    urdf: Text | None = None
    links: dict[Name, LinkSection] = {}
    joints: Annotated[list[Text], Field(min_length=1, max_length=20)]
    frozen: dict[str, Annotated[float, Field(ge=-1e6, le=1e6)]] = {}
    damped: bool = True
    tool: PinSection
    payload: Annotated[dict[Name, PayloadSection], Field(min_length=1, max_length=50)]
    fluid: FluidSection
    supply: SupplySection
    cylinder: Annotated[dict[Name, CylinderSection], Field(min_length=1)]
    motor: dict[Name, MotorSection] = {}
    spring: dict[Name, SpringSection] = {}
    lift_chart: LiftChartSection | None = None
    stability: StabilitySection | None = None
    requirements: RequirementsSection = RequirementsSection()
    bands: BandsSection = BandsSection()
    tolerances: TolerancesSection = TolerancesSection()
