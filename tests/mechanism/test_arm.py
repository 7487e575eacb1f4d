"""Reading a URDF: every fault is refused in one line that names the culprit, the rest is what
Pinocchio would compute.

Expected numbers: the same arm written another way (limiting case), or Pinocchio on the untouched
URDF (independent).
"""

from __future__ import annotations

import gc
import math
import weakref
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import ArmDesignError
from armdesign.mechanism.arm import Arm
from tests.machines import BOOM, BUCKET, STICK, Joint, urdf

TELESCOPE = Joint(
    "slide", "stick", xyz=(0.5, 0.1, 0), rpy=(0.3, 0, 0.2), axis=(1, 0.5, 0), kind="prismatic"
)
ARM = urdf(
    [
        BOOM,
        STICK,
        TELESCOPE,
        replace(BUCKET, parent="slide", rpy=(0.2, 0.3, -0.4), axis=(0.3, -1, 0.2)),
    ]
)
ALL = ["boom", "stick", "slide", "bucket"]


def arm(
    text: str = ARM, joints: list[str] | None = None, frozen: dict[str, float] | None = None
) -> Arm:
    return Arm(text, joints or ALL, frozen or {}, "test.urdf")


def edited(old: str, new: str) -> str:
    assert old in ARM, f"the edit {old!r} finds nothing"
    return ARM.replace(old, new, 1)


def joint_of_type(kind: str) -> str:
    return edited('name="stick" type="revolute"', f'name="stick" type="{kind}"')


AXIS = '<axis xyz="0.0 -1.0 0.0"/>'
FAULTS = {
    "not XML": (ARM[:-8], "not well-formed"),
    "not a robot": ("<sdf/>", "<sdf>"),
    "no text": ("", "not well-formed"),
    "planar": (joint_of_type("planar"), "joint stick: type .planar."),
    "floating": (joint_of_type("floating"), "joint stick: type .floating."),
    "fixed coordinate": (joint_of_type("fixed"), "joint stick: is fixed"),
    "mimic": (edited(AXIS, f'{AXIS}<mimic joint="stick"/>'), "joint boom: mimics"),
    "no limit": (
        edited('<limit lower="-0.3" upper="0.3" effort="1" velocity="1"/>', ""),
        "joint boom: has no <limit>",
    ),
    "limits swapped": (edited('lower="-0.3"', 'lower="0.4"'), r"joint boom: limits \[0.4, 0.3\]"),
    "limits not given": (edited('lower="-0.3" upper="0.3"', ""), "joint boom: limits"),
    "limit NaN": (edited('lower="-0.3"', 'lower="nan"'), 'joint boom: lower="nan"'),
    "limit infinite": (edited('upper="0.3"', 'upper="inf"'), 'joint boom: upper="inf"'),
    "limit a word": (edited('upper="0.3"', 'upper="far"'), 'joint boom: upper="far"'),
    "axis zero": (edited(AXIS, '<axis xyz="0 0 0"/>'), "joint boom: the axis has no length"),
    "axis short": (edited(AXIS, '<axis xyz="0 1"/>'), 'joint boom: xyz="0 1" is not 3'),
    "origin NaN": (edited('xyz="2.5 0.0 0.0"', 'xyz="nan 0 0"'), "joint stick: xyz"),
    "mass NaN": (edited('mass value="300"', 'mass value="nan"'), 'link boom: value="nan"'),
    "mass negative": (
        edited('mass value="300"', 'mass value="-3"'),
        "link boom: mass -3 kg is negative",
    ),
    "no mass": (edited('<mass value="300"/>', ""), "link boom: <inertial> lacks"),
    "inertia no body has": (
        edited('ixy="0"', 'ixy="1e4"'),
        "link boom: no body has principal inertias",
    ),
    "two joints of a name": (
        edited('joint name="stick"', 'joint name="boom"'),
        'two joints are named "boom"',
    ),
    "two links of a name": (
        edited('link name="stick"', 'link name="boom"'),
        'two links are named "boom"',
    ),
    "no name": (edited('joint name="stick" ', "joint "), "a joint has no name"),
    "two roots": (
        edited('<link name="root"/>', '<link name="root"/><link name="other"/>'),
        "2 root links",
    ),
    "two parents": (
        edited('<child link="stick"/>', '<child link="boom"/>'),
        'joint stick: link "boom" has two parents',
    ),
    "no such link": (
        edited('<parent link="boom"/>', '<parent link="bom"/>'),
        'joint stick: parent link "bom"',
    ),
    "a ring": (
        edited('<parent link="root"/>', '<parent link="bucket"/>'),
        "links boom, .* are not connected",
    ),
}


@pytest.mark.parametrize(("text", "message"), FAULTS.values(), ids=FAULTS)
def test_a_faulty_urdf_is_refused_by_name_in_one_line(text: str, message: str) -> None:
    with pytest.raises(ArmDesignError, match=message) as caught:
        arm(text)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("test.urdf")


@pytest.mark.parametrize(
    ("joints", "frozen", "message"),
    [
        (["boom", "stik"], {}, "joint stik: is not in the URDF .*; did you mean .stick.\\?"),
        (["boom"], {"swing": 1.0}, "joint swing: is not in the URDF"),
        (
            ["boom"],
            {"stick": 0.4},
            r"joint stick: is frozen at 0.4, outside its limits \[-0.3, 0.3\]",
        ),
        (["boom"], {"stick": math.nan}, "joint stick: is frozen at nan"),
    ],
)
def test_joints_that_the_urdf_does_not_have(
    joints: list[str], frozen: dict[str, float], message: str
) -> None:
    with pytest.raises(ArmDesignError, match=message):
        arm(joints=joints, frozen=frozen)


def test_a_fixed_joint_cannot_be_frozen_elsewhere() -> None:
    """It would be ignored in silence."""
    with pytest.raises(ArmDesignError, match="joint stick: is fixed in the URDF"):
        arm(joint_of_type("fixed"), joints=["boom", "slide", "bucket"], frozen={"stick": 0.2})


@pytest.mark.parametrize("written", [" 300 ", "3e2", "+300.0", "3_00"])
def test_numbers_in_any_spelling_reach_pinocchio(written: str) -> None:
    """Pinocchio's parser drops a body whose mass it cannot read, in silence; ours hands it plain
    numbers.
    """
    q = np.zeros((1, 4))
    mass = arm(edited('mass value="300"', f'mass value="{written}"')).rigid_poses(q).mass_matrix
    assert_allclose(mass, arm().rigid_poses(q).mass_matrix, rtol=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        edited('<robot name="odd">', "<robot>"),
        edited(
            '<robot name="odd">', '<robot name="odd" version="9" xmlns:xacro="http://ros.org">'
        ),
        edited(
            AXIS, f'{AXIS}<dynamics damping="?"/><safety_controller/><calibration rising="?"/>'
        ),
        edited(
            "</robot>",
            '<transmission><joint name="boom"/></transmission><gazebo/><material'
            ' name="red"/></robot>',
        ),
        edited(
            '<link name="boom">',
            '<link name="boom"><visual><geometry><mesh filename="x"/></geometry></visual>',
        ),
        edited(' effort="1" velocity="1"', ""),
    ],
)
def test_what_does_not_matter_does_not_disturb(text: str) -> None:
    q = np.array([[0.1, -0.2, 0.2, 0.1]])
    assert_allclose(
        arm(text).rigid_poses(q).mass_matrix, arm().rigid_poses(q).mass_matrix, rtol=1e-15
    )


@pytest.mark.parametrize(
    "frozen", [{"stick": 0.23}, {"slide": -0.17}, {"stick": -0.11, "slide": 0.29}, {"boom": 0.3}]
)
def test_a_frozen_joint_is_the_full_arm_at_that_value(frozen: dict[str, float]) -> None:
    """Revolute and prismatic joints baked into the URDF: M, g, ∂g/∂q and all links as the full arm
    has them there.
    """
    free = [name for name in ALL if name not in frozen]
    rows = [ALL.index(name) for name in free]
    q = np.random.default_rng(1).uniform(-0.3, 0.3, (3, 4))
    for name, value in frozen.items():
        q[:, ALL.index(name)] = value
    full, reduced = arm(), arm(joints=free, frozen=frozen)
    a, b = full.rigid_poses(q), reduced.rigid_poses(q[:, rows])
    scale = np.abs(a.mass_matrix).max()
    assert_allclose(b.mass_matrix, a.mass_matrix[:, rows][:, :, rows], atol=1e-12 * scale)
    assert_allclose(b.gravity_torque, a.gravity_torque[:, rows], atol=1e-10 * scale)
    assert_allclose(
        b.gravity_stiffness, a.gravity_stiffness[:, rows][:, :, rows], atol=1e-10 * scale
    )
    for link in full.links:
        at = np.array([0.4, 0.3, -0.2])
        assert_allclose(reduced.point(b, link, at), full.point(a, link, at), atol=1e-12)


def test_a_continuous_joint_is_a_revolute_one_with_a_whole_turn() -> None:
    """Against Pinocchio, which keeps cos and sin of a continuous joint, also for the frozen one
    before it.
    """
    text = urdf([replace(BOOM, kind="continuous"), replace(STICK, kind="continuous"), BUCKET])
    model = pinocchio.buildModelFromXML(text)
    boom, stick, bucket = -2.5, 1.2, 0.1
    turned = np.array([math.cos(boom), math.sin(boom), math.cos(stick), math.sin(stick), bucket])
    mass = pinocchio.crba(model, model.createData(), turned)
    mass = np.triu(mass) + np.triu(mass, 1).T
    whole = arm(text, ["boom", "stick", "bucket"])
    assert_allclose(whole.limits[:2], [[-math.pi, math.pi]] * 2)
    assert_allclose(
        whole.rigid_poses(np.array([[boom, stick, bucket]])).mass_matrix[0], mass, rtol=1e-10
    )
    part = arm(text, ["stick", "bucket"], {"boom": boom})
    assert_allclose(
        part.rigid_poses(np.array([[stick, bucket]])).mass_matrix[0], mass[1:, 1:], rtol=1e-10
    )


@pytest.mark.parametrize("order", [[3, 1, 0, 2], [1, 0, 3, 2]])
def test_joints_may_come_in_another_order_than_the_tree(order: list[int]) -> None:
    q = np.random.default_rng(2).uniform(-0.3, 0.3, (2, 4))
    tree, other = (
        arm().rigid_poses(q),
        arm(joints=[ALL[i] for i in order]).rigid_poses(q[:, order]),
    )
    assert_allclose(other.mass_matrix, tree.mass_matrix[:, order][:, :, order], rtol=1e-12)
    assert_allclose(other.gravity_torque, tree.gravity_torque[:, order], rtol=1e-12)
    assert_allclose(
        other.gravity_stiffness,
        tree.gravity_stiffness[:, order][:, :, order],
        rtol=1e-12,
        atol=1e-9,
    )
    assert_allclose(other.translation, tree.translation[:, order], rtol=1e-12)


def test_names_that_pinocchio_uses_itself() -> None:
    """Link and joint of one name are the rule in `machines.py`; "universe" is Pinocchio's own name
    for the world.
    """
    plain = urdf([BOOM, STICK])
    odd = plain.replace('"stick"', '"universe"').replace('"boom"', '"root_joint"')
    q = np.array([[0.2, -0.1]])
    expected = arm(plain, ["stick", "boom"]).rigid_poses(q)
    assert_allclose(
        arm(odd, ["universe", "root_joint"]).rigid_poses(q).mass_matrix,
        expected.mass_matrix,
        rtol=1e-15,
    )


@pytest.mark.parametrize("values", [3, 50])
def test_poses_that_nobody_needs_leave_memory_at_once(values: int) -> None:
    """Without the collector of cycles, which comes late to few large arrays."""
    q = np.random.default_rng(4).uniform(-0.3, 0.3, (50, 4))
    q[:, 0] = np.arange(50) % values / 100
    poses = arm().rigid_poses(q)
    left, few = weakref.ref(poses), poses.distinct(0)[0]
    assert len(few) == values
    gc.disable()
    try:
        del poses, few
        assert left() is None
    finally:
        gc.enable()


def test_the_axis_may_have_any_length() -> None:
    text = edited(AXIS, '<axis xyz="0 -0.001 0"/>')
    q = np.array([[0.1, 0.2, 0.3, 0.1]])
    assert_allclose(
        arm(text).rigid_poses(q).mass_matrix, arm().rigid_poses(q).mass_matrix, rtol=1e-12
    )
    assert_allclose(arm(text).rigid_poses(q).axis, arm().rigid_poses(q).axis, rtol=1e-12)


def test_poses_with_equal_values_of_several_joints_are_worked_out_once() -> None:
    """Each pose finds its own values again; joints that all differ give the poses themselves."""
    q = np.random.default_rng(6).uniform(-0.3, 0.3, (60, 4))
    q[:, 0], q[:, 2] = np.arange(60) % 3 / 10, np.arange(60) % 4 / 10
    poses = arm().rigid_poses(q)
    few, back = poses.distinct(0, 2)
    assert len(few) == 12
    assert_allclose(few.q[back][:, [0, 2]], q[:, [0, 2]], rtol=0)
    same, every = poses.distinct(0, 1)
    assert same is poses
    assert every == slice(None)


def test_a_linkage_has_the_same_bits_whatever_other_poses_are_asked_for() -> None:
    """Its joint is placed alone, with all that is before it at zero."""
    machine = ad.load("excavator_20t")
    q = ad.Workspace.grid(machine, 5).q
    poses = machine.at(q)
    for rows in (slice(1), slice(7, 40), np.arange(len(q))[::-1]):
        some = machine.at(q[rows])
        assert np.array_equal(some.lengths, poses.lengths[rows])
        assert np.array_equal(some.moment_arms, poses.moment_arms[rows])
        assert np.array_equal(some.moment_arm_derivatives, poses.moment_arm_derivatives[rows])
