"""Analytic linear models against differences of the plant, of order 8, and their names."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine
from armdesign.errors import PoseError, SimulationError
from armdesign.machine import template
from tests import machines, sprung
from tests.simulation import differences
from tests.simulation import valves as helpers
from tests.simulation.plant.valve_machines import holding
from tests.simulation.valves import WORST

EVERYDAY = (
    *("excavator_20t", "loader_crane", "paper_1dof"),
    *("slewing", "rocking", "crossing", "random_0", "sprung_0"),
)
MORE = (
    *("excavator_12t", "mini_excavator_2t", "patu_boom", "heavy_bars"),
    *(name for name in machines.ODD if name not in EVERYDAY),
    *("random_1", "random_2", "random_3", "random_4", "random_5", "sprung_1", "sprung_2"),
)
ALL = (*EVERYDAY, *(pytest.param(name, marks=pytest.mark.slow) for name in MORE))


def named(name: str) -> Machine:
    if name.startswith("sprung_"):
        return helpers.with_valves(sprung.random_sprung(int(name.removeprefix("sprung_"))))
    return helpers.with_valves(machines.named(name))


@pytest.mark.parametrize("name", ALL)
def test_linear_models_are_differences_of_the_plant(name: str) -> None:
    """Every entry of A, B and the pistons' C, one pose at a time and all at once."""
    machine = named(name)
    poses = machines.inner_poses(machine, 3)
    models = ad.linear_models(machine, poses)
    for row, pose in enumerate(poses):
        one = ad.linearize(machine, pose)
        differences.assert_same(differences.plant_of(machine, pose), one, 1e-8)
        for matrix in "ABCD":
            ours, theirs = getattr(models[row], matrix), getattr(one, matrix)
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9 * np.abs(theirs).max())


@pytest.mark.parametrize(
    "changes",
    [
        {"valve.leakage_l_per_min_per_bar": 0.02},
        {"valve.tank_leakage_l_per_min_per_bar": 0.005, "valve.overlap_percent": -3},
        {"valve.overlap_percent": -5, "friction.viscous_N_s_per_m": 2e5},
        {"valve.overlap_percent": 5},
        {"valve.preload_bar": 40, "count": 2},
        {"compliance_m_per_N": 2e-8, "valve.leakage_l_per_min_per_bar": 0.02},
    ],
)
@pytest.mark.parametrize("pump", ["flow_limited", "ideal"])
def test_valves_and_oil_of_every_kind(changes: dict[str, float], pump: str) -> None:
    """Leaks, underlap, overlap, preload, compliance, air, both kinds of pump."""
    machine = machines.named("excavator_20t").with_payload("full")
    paths = {f"cylinder.{name}.{k}": v for name in ("boom", "stick") for k, v in changes.items()}
    machine = machine.replace(paths | {"fluid.entrained_air_percent": 1.0, "supply.pump": pump})
    model = ad.linearize(machine, WORST)
    differences.assert_same(differences.plant_of(machine, np.array(WORST)), model, 1e-7)


def test_groups_cover_all_names_in_order() -> None:
    model = ad.linearize(machines.named("rocking"), WORST)
    for names, groups in (
        (model.states, model.state_groups),
        (model.inputs, model.input_groups),
        (model.outputs, model.output_groups),
    ):
        covered = [k for group in groups.values() for k in range(*group.indices(len(names)))]
        assert covered == list(range(len(names)))
        assert len(set(names)) == len(names)
    cap = model.state_groups["cap pressures"]
    assert model.states[cap] == tuple(f"{a} cap pressure" for a in ("boom", "stick", "bucket"))


def test_selected_signals_are_rows_and_columns() -> None:
    models = ad.linear_models(machines.named("excavator_20t"), [WORST, WORST])
    few = models.select(["tool force", "boom"], ("stick cap pressure", "tool acceleration"))
    assert few.inputs == (*models.inputs[3:], "boom")
    assert few.outputs == ("stick cap pressure", *models.outputs[-3:])
    assert few.input_groups["boom"] == slice(3, 4)
    columns = [3, 4, 5, 0]
    rows = [models.outputs.index(name) for name in few.outputs]
    np.testing.assert_array_equal(few.B, models.B[:, :, columns])
    np.testing.assert_array_equal(few.C, models.C[:, rows])
    np.testing.assert_array_equal(few.D, models.D[:, rows][:, :, columns])
    assert few[1].select(outputs="tool acceleration").C.shape == (3, 19)
    assert len(models[:1]) == 1
    with pytest.raises(SimulationError, match='no input or group of inputs "comands"; did you'):
        models.select("comands")


def test_a_force_at_the_tool_does_the_work_of_its_path() -> None:
    """Response to a tool force by (K − ω² M)⁻¹ Jᵀ f with trapped oil, J by differences."""
    machine = helpers.without_losses(machines.named("excavator_20t")).with_payload("full")
    machine = machine.replace({"supply.pump": "ideal"})
    model, poses = ad.linearize(machine, WORST), machine.at(WORST)
    few = model.select("tool force", ("joint positions", "tool position", "tool acceleration"))
    omega = 0.5
    response = few.C @ np.linalg.solve(1j * omega * np.eye(18) - few.A, few.B) + few.D
    step = 1e-6 * np.eye(3)
    tips = [machine.at(WORST + sign * step).tool for sign in (1, -1)]
    jacobian = ((tips[0] - tips[1]) / 2e-6).T
    dynamic = poses.stiffness_matrix[0] - omega**2 * poses.mass_matrix[0]
    joints = np.linalg.solve(dynamic, jacobian.T)
    np.testing.assert_allclose(response[:3], joints, rtol=1e-6, atol=1e-9 * np.abs(joints).max())
    tool = jacobian @ joints
    limit = 1e-6 * np.abs(tool).max()
    np.testing.assert_allclose(response[3:6], tool, atol=limit)
    np.testing.assert_allclose(response[6:], -(omega**2) * tool, atol=limit)


def test_bad_poses_are_told() -> None:
    machine = machines.named("excavator_20t")
    with pytest.raises(PoseError, match="holds 2 poses; give one"):
        ad.linearize(machine, [WORST, WORST])
    with pytest.raises(PoseError, match="holds no pose"):
        ad.linear_models(machine, np.zeros((0, 3)))


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("by", ["speed", "opening"])
def test_steady_motion_is_steady_and_its_model_the_plants(name: str, by: str) -> None:
    """The plant accelerates neither joints nor driven pressures, and differences agree."""
    machine, rng = named(name), np.random.default_rng(1)
    count = len(machine.joints if by == "speed" else machine.actuators)
    if by == "opening" and count != len(machine.joints):
        return
    for pose in machines.inner_poses(machine, 2):
        moved = rng.uniform(0.01, 0.05, count) * rng.choice([-1, 1], count)
        model = ad.linearize(machine, pose, **{by: 4 * moved if by == "opening" else moved})
        state = model.equilibrium
        plant = differences.carrying(differences.plant_of(machine, pose), state)
        groups, command = model.state_groups, state[model.state_groups["spools"]]
        rates = plant.derivative(state[None] / plant.units, command[None])[0] * plant.units
        speeds = state[groups["speeds"]][: len(machine.joints)]
        np.testing.assert_allclose(rates[groups["speeds"]], 0, atol=1e-9)
        pressures = slice(groups["cap pressures"].start, groups["supply pressure"].stop)
        stiffest = np.abs(np.diag(model.A)[pressures]).max() * state[pressures].max()
        np.testing.assert_allclose(rates[pressures], 0, atol=1e-9 * stiffest)
        if by == "speed":
            np.testing.assert_allclose(speeds, moved, rtol=1e-12)
        else:
            np.testing.assert_array_equal(command, 4 * moved)
        differences.assert_same(plant, model, 1e-7)


def test_steady_motion_of_a_symmetric_cylinder_is_the_orifice_law() -> None:
    """A (p1 − p2) = F with both edges alike: Q = K x √((p_s − p_t − F/A)/2) (Merritt 1967, ch. 6),
    without what is laminar near zero.
    """
    changes = {"cylinder.lift.rod_mm": 1e-3, "supply.pump": "ideal"}
    machine = helpers.with_valves(ad.load("paper_1dof").replace(changes))
    poses, cylinder, supply = machine.at([0.1]), machine.cylinders[0], machine.supply
    model = ad.linearize(machine, [0.1], opening=0.3)
    groups, state = model.state_groups, model.equilibrium
    joint = state[groups["speeds"]][0]
    force = poses.cylinder_forces[0, 0] + cylinder.friction.viscous * joint
    drop = supply.pressure - supply.return_pressure - force / cylinder.bore_area
    assert cylinder.valve is not None
    flow = 0.3 * cylinder.valve.gain * np.sqrt(drop / 2)
    speed = poses.moment_arms[0, 0, 0] * joint
    assert speed * cylinder.bore_area == pytest.approx(flow, rel=1e-3)


def test_what_is_not_told_to_move_holds(excavator: Machine) -> None:
    """Tight valves as at rest; leaking ones by the spool position that makes up for the leak."""
    underlap = {f"cylinder.{name}.valve.overlap_percent": -2 for name in ("boom", "stick")}
    for machine in (excavator, excavator.replace(underlap)):
        equilibrium = ad.linearize(machine, WORST)
        moving = ad.linearize(machine, WORST, opening={"bucket": 0.02})
        for index in (0, 1):
            for group in ("cap pressures", "annulus pressures", "spools"):
                at = equilibrium.state_groups[group].start + index
                expected = pytest.approx(equilibrium.equilibrium[at], rel=1e-2, abs=1e-4)
                assert moving.equilibrium[at] == expected
        speeds = moving.equilibrium[moving.state_groups["speeds"]]
        np.testing.assert_allclose(speeds[:2], 0, atol=1e-9)
        assert abs(speeds[2]) > 0.01


@pytest.mark.parametrize("pump", ["ideal", "flow_limited"])
def test_what_leaks_and_is_not_told_to_move_holds_as_at_rest(pump: str) -> None:
    """A lapped valve of which the piston leaks has two positions at which nothing moves."""
    lifter = Machine.from_text(template.new("lifter", links=2), "", Path("lifter.toml"))
    leaking = {"cylinder.stick.valve.leakage_l_per_min_per_bar": 2e-4, "supply.pump": pump}
    machine, moved = lifter.replace(leaking).with_payload("full"), {"boom": 0.02}
    poses = np.array([[0.3, -2.163], [0.003, -1.658], [-0.238, -1.837], [-0.289, -1.379]])
    models = ad.linear_models(machine, poses, opening=moved)
    rest = ad.linear_models(machine, poses)
    groups = models[0].state_groups
    stick = [groups[f"{side} pressures"].start + 1 for side in ("cap", "annulus")]
    for pose, model, still in zip(poses, models, rest, strict=True):
        np.testing.assert_allclose(model.equilibrium[stick], still.equilibrium[stick], rtol=0.02)
        assert abs(model.equilibrium[groups["speeds"]][0]) > 1e-3
        alone = ad.linearize(machine, pose, opening=moved)
        np.testing.assert_allclose(alone.equilibrium, model.equilibrium, rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        ({"opening": {"boom": 1.3}}, "boom: an opening of 1.3 is beyond ±1; give 1 at most"),
        ({"opening": {"bom": 0.3}}, 'no actuator "bom"; did you mean "boom"?'),
        ({"opening": 0.1, "speed": 0.1}, "has openings and joint speeds; give one of the two"),
        ({"speed": [1.0, 2.0]}, "speed is no array of 3 numbers"),
        ({"speed": [np.nan, 0.0, 0.0]}, "speed holds a number that is not finite"),
        ({"speed": [1.5, 0.0, 0.0]}, "needs 759.4 l/min, the pump gives 429.0; 0.56 of it can be"),
        ({"speed": [100.0, 0.0, 0.0]}, "the pump gives 429.0; 0.0083 of it can be: give speeds"),
    ],
)
def test_motions_that_cannot_be_are_told(motion: dict[str, object], words: str) -> None:
    machine = machines.named("excavator_20t").with_payload("full")
    with pytest.raises(SimulationError, match=re.escape(words)):
        ad.linearize(machine, WORST, **motion)  # type: ignore[arg-type]


def test_the_share_that_is_told_can_be() -> None:
    machine = machines.named("excavator_20t").replace({"supply.pump": "ideal"})
    with pytest.raises(SimulationError, match="valve, fully open, passes less") as error:
        ad.linearize(machine, WORST, speed=[4.0, 0.0, 0.0])
    share = float(error.value.remedy.rpartition(" ")[2])
    assert share > 2.0
    assert ad.linearize(machine, WORST, speed=[share, 0.0, 0.0]).stable


def test_a_chamber_that_vapour_would_fill_is_named() -> None:
    """The load lowers the boom faster than its fully open valve fills the annulus."""
    with pytest.raises(SimulationError, match=r"vapour would fill boom's annulus; 0\.9"):
        ad.linearize(
            machines.named("excavator_20t"), [-0.7216, -0.6287, -2.1913], opening={"boom": -1.0}
        )


def test_unstable_poses_are_told_with_a_stable_one() -> None:
    """On oil a hundred times too soft; of many poses they are flagged, by K ≻ 0."""
    machine = machines.named("excavator_20t").replace({"fluid.bulk_modulus_MPa": 10.0})
    poses = machines.inner_poses(machine, 200)
    models = ad.linear_models(machine, poses)
    lowest = ad.natural_modes(machine.at(poses)).frequencies[:, 0]
    np.testing.assert_array_equal(models.stable, lowest > 0)
    assert not models.stable.all()
    worst = poses[~models.stable][0]
    with pytest.raises(SimulationError, match="unstable on its trapped oil at boom") as error:
        ad.linearize(machine, worst)
    pose = error.value.remedy.partition("mid range is ")[2]
    stable = [float(word.split()[1].rstrip("°")) for word in pose.split(", ")]
    assert ad.linearize(machine, np.radians(stable)).stable


@pytest.mark.parametrize("opening", [-0.2, 0.2])
def test_a_load_holding_valve_in_motion(opening: float) -> None:
    """It throttles what leaves the cap: the pilot pressure of the annulus holds it partly open."""
    plain = machines.named("excavator_20t").with_payload("full").replace({"supply.pump": "ideal"})
    machine = holding(plain, "boom", side="cap", pilot_ratio=3.0, opening_range_bar=100)
    model = ad.linearize(machine, WORST, opening={"boom": opening})
    pose = np.array(WORST)
    differences.assert_same(differences.plant_of(machine, pose), model, 1e-7)
    free = ad.linearize(plain, WORST, opening={"boom": opening})
    speeds = [abs(one.equilibrium[one.state_groups["speeds"]][0]) for one in (model, free)]
    assert (speeds[0] < 0.99 * speeds[1]) == (opening < 0)
