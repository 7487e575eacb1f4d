"""Faults that only the assembled machine shows, and why a joint has no range or part of one.

Each cause of a wrong range is tried: the range is worked out again with the axis reversed, with
limits taken as degrees, with the knee of a four-bar on its other side, with one length or pin
taken as metres. A cause is named if the strokes fit the limits of the URDF with this correction,
and do not fit them without it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armdesign.errors import MachineFileError
from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine.file.likely_values import MISTAKEN, rounded
from armdesign.machine.poses import is_singular
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.joint_ranges import joint_ranges, over, sweep
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.urdf_faults import line_of, parse
from armdesign.units import deg, mm

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

NO_DIGGING = "the {} cylinder has no digging force: it turns no single joint between root and tool"


def assembly_faults(machine: Machine) -> Iterator[MachineFileError]:
    """Every fault of the drives; where there is none, of the joint ranges, and of digging."""
    faults = list(_of_drives(machine))
    yield from faults or [*_of_ranges(machine), *_of_digging(machine)]


def _of_drives(machine: Machine) -> Iterator[MachineFileError]:
    """Cylinders that span no joint, odd linkages, motors that turn nothing, undriven joints."""
    source, arm = machine.source.name, machine.arm
    for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
        where = f"{source}: cylinder.{cylinder.name}"
        if not linkage.joints:
            remedy = "put its pins on links that move to each other"
            yield MachineFileError(where, "no joint lies between its pins", remedy)
        elif fault := linkage.fault(where):
            yield fault
    for motor in machine.motors:
        if not arm.joints[arm.names.index(motor.joint)].revolute:
            where = f"{source}: motor.{motor.name}"
            yield MachineFileError(where, f'"{motor.joint}" does not turn', "use a cylinder")
    yield from _of_springs(machine)
    driven = {j for drive in machine.drives for j in drive.joints}
    for j, joint in enumerate(arm.joints):
        if j not in driven:
            words = f'no cylinder or motor moves "{joint.name}"'
            yield MachineFileError(f"{source}: joints", words, "add one or freeze the joint")
    yield from _of_idle(machine)


def _of_idle(machine: Machine) -> Iterator[MachineFileError]:
    """Idle cylinders with masses that have no place, as they do not close where they stand."""
    for cylinder, linkage in machine.idle_cylinders:
        if cylinder.moving_masses and not linkage.idle_length() > 0:
            part = f"{machine.source.name}: cylinder.{cylinder.name}"
            joints = machine.idle[cylinder.name]
            values = (f"{name} = {machine.section.frozen.get(name, 0.0):g}" for name in joints)
            fault = f"has masses and does not close at the frozen {', '.join(values)}"
            words = linkage.closing_words or "its pins must not coincide"
            yield MachineFileError(part, fault, f"freeze it elsewhere: {words}")


def _of_springs(machine: Machine) -> Iterator[MachineFileError]:
    """Springs on joints of another kind, standing beyond their limits, or between pins."""
    source, arm = machine.source.name, machine.arm
    for index, spring in enumerate(machine.springs, len(arm.joints)):
        where, joint = f"{source}: spring.{spring.name}", arm.coordinates[index]
        for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
            if index in linkage.joints:
                fault = f'"{joint.name}" lies between the pins of cylinder.{cylinder.name}'
                remedy = "a spring's joint is driven by nothing: choose another, or move the pins"
                yield MachineFileError(f"{where}.joint", fault, remedy)
        if joint.revolute != spring.revolute:
            moves, meant = ("turns", "N_m_per_rad") if joint.revolute else ("slides", "N_per_m")
            remedy = f"give stiffness_{meant}, and at_{'deg' if joint.revolute else 'mm'}"
            fault = f'"{joint.name}" {moves}'
            yield MachineFileError(f"{where}.{spring.stiffness_key}", fault, remedy)
        elif not joint.lower <= spring.at <= joint.upper:
            key, unit = ("at_deg", deg) if joint.revolute else ("at_mm", mm)
            low, high = joint.lower / unit, joint.upper / unit
            fault = f'{spring.at / unit:g} is outside the limits of "{joint.name}"'
            place = "of the joint" if machine.section.links else "in the URDF"
            remedy = f"give {key} in [{low:g}, {high:g}], or widen the limits {place}"
            yield MachineFileError(f"{where}.{key}", fault, remedy)


def _of_ranges(machine: Machine) -> Iterator[MachineFileError]:
    """Joints without a range; else cylinders that leave a motion free amid all ranges."""
    source = machine.source.name
    try:
        middle = machine.ranges.mean(axis=1)[None]
    except MachineFileError:
        pairs = list(zip(machine.linkages, machine.cylinders, strict=True))
        for j in range(len(machine.joints)):
            own = [(linkage, cylinder) for linkage, cylinder in pairs if linkage.joints == (j,)]
            linkages, cylinders = tuple(k for k, _ in own), tuple(c for _, c in own)
            try:
                joint_ranges(machine.arm, linkages, cylinders, 0.0, source)
            except MachineFileError as error:
                yield from _with_cause(machine, j, own, error)
        return
    arms = machine.evaluate(machine.rigid_poses(middle)).moment_arms[..., : len(machine.joints)]
    if is_singular(arms)[0]:
        fault = "cylinders and motors leave a direction of motion free"
        yield MachineFileError(f"{source}: cylinder", fault, "check the pins")


def _of_digging(machine: Machine) -> Iterator[MachineFileError]:
    """Digging forces asked of cylinders that have none."""
    arm, requirements = machine.arm, machine.section.requirements
    asked = [(f"digging_kN.{name}", name) for name in requirements.digging_kN]
    if requirements.digging:
        asked += [("digging.cylinders", name) for name in requirements.digging.cylinders]
    turning = [(j,) for j in arm.chain(machine.tool.link) if arm.coordinates[j].revolute]
    pairs = zip(machine.cylinders, machine.linkages, strict=True)
    without = {cylinder.name for cylinder, linkage in pairs if linkage.joints not in turning}
    for key, name in asked:
        if name in without:
            part = f"{machine.source.name}: requirements.{key}"
            yield MachineFileError(part, NO_DIGGING.format(name), "leave it out")


def _with_cause(
    machine: Machine, j: int, own: Own, error: MachineFileError
) -> Iterator[MachineFileError]:
    """A joint without a range, with its likely cause; one in the URDF is a fault of its own."""
    cause = cause_of(machine.arm, j, own, faulty=True)
    if cause is None:
        yield error
    elif cause.in_urdf:
        part, line = place_in_urdf(machine, j, cause)
        yield MachineFileError(part, f"{cause.words}; now {error.fault}", cause.remedy, line)
        yield error
    else:
        source = f"{machine.source.name}: "
        fault = f"{cause.words}: {error.part.removeprefix(source)}: {error.fault}"
        yield MachineFileError(source + cause.path, fault, f"{cause.remedy}, or {error.remedy}")


def place_in_urdf(machine: Machine, j: int, cause: Cause) -> tuple[str, int | None]:
    """Part and line of a cause in the URDF: a joint's axis or limits, or the whole file."""
    source, name = str(machine.section.urdf), machine.joints[j]
    if cause.path == "urdf":
        return source, None
    joints = parse(machine.urdf_text, source).findall("joint")
    joint = next(element for element in joints if element.get("name") == name)
    element = joint.find({"axis": "axis", "limits": "limit"}[cause.path])
    return f"{source}: joint {name}", line_of(joint if element is None else element)


# ------------------------------------------------------------------------------------ joint ranges


Own = list[tuple[Linkage, Cylinder]]  # what moves one joint alone
MENDS = 0.3  # fit of strokes and limits that is enough for a cause of what cannot be used at all
# and for lengths in centimetres or inches, so near to millimetres that they may fit by chance
BY_CHANCE = 0.8
ODD, FITS = 0.85, 0.97  # the fit that is enough beside one below ODD
ALIKE, FITS_EXACTLY = 0.97, 0.995  # and beside one below ALIKE
TURN = 2 * np.pi + 0.01  # [rad] beyond which no cylinder turns a joint
LARGEST_ARM = 50.0  # [m] from joint to joint, beyond which lengths are hardly metres
SMALLEST_ARM = 0.05  # [m] below which lengths given in mm are hardly millimetres
SAMPLES = 61
LENGTHS = {"stroke_mm": "stroke", "closed_length_mm": "closed_length"}


@dataclass(frozen=True, kw_only=True)
class Cause:
    """Likely cause of a missing or doubtful joint range, and what to write instead.

    ``path`` is a key path, or "axis", "limits", "urdf" of the URDF; ``least`` is the fit that it
    takes to be believed.
    """

    path: str
    words: str
    remedy: str
    fit: float = 0.0
    least: float = 0.0

    @property
    def in_urdf(self) -> bool:
        """Whether the fault is in the URDF."""
        return self.path in ("axis", "limits", "urdf")


def cause_of(arm: Arm, joint: int, own: Own, faulty: bool) -> Cause | None:
    """Likeliest cause of a joint without a range (``faulty``), or unlike its strokes."""
    now = 0.0 if faulty else _fit(arm, joint, own)
    if now > ALIKE:
        return None
    tried = [
        dataclasses.replace(cause, fit=_fit(*trial)) for cause, trial in _trials(arm, joint, own)
    ]
    common = MENDS if faulty else FITS if now < ODD else FITS_EXACTLY
    best = max((cause.fit for cause in tried), default=0.0)
    likely = (cause for cause in tried if cause.fit >= max(common, cause.least))
    # the simplest of those that are about as good
    return next((cause for cause in likely if cause.fit > 0.95 * best), None)


def _fit(arm: Arm, joint: int, own: Own) -> float:
    """Share of the limits that the strokes cover, times the least share of a stroke in use."""
    linkages, cylinders = tuple(k for k, _ in own), tuple(c for _, c in own)
    lower, upper = arm.limits[joint]
    try:
        with np.errstate(all="ignore"):
            low, high = joint_ranges(arm, linkages, cylinders, 0.0, "")[joint]
            poses = sweep(arm, joint, over(np.array([low, high]), SAMPLES))
            used = min(float(np.ptp(k.length(poses))) / c.stroke for k, c in own)
    except MachineFileError:
        return 0.0
    return used * float((high - low) / (upper - lower))


def _trials(arm: Arm, joint: int, own: Own) -> Iterator[tuple[Cause, tuple[Arm, int, Own]]]:
    """Causes, simple ones first, each with the arm and cylinders that it would leave."""
    of_joint = _trials_of_links if arm.of_links else _trials_of_urdf
    for cause, limits in of_joint(arm, joint):
        yield cause, (arm.within(joint, *limits), joint, own)
    yield from ((cause, (arm, joint, other)) for cause, other in _mirrored(own))
    for unit, factor in MISTAKEN["mm"].items():
        for keys, enlarged in _enlarged(own, factor):
            yield _of_keys(own, keys, unit, factor), (arm, joint, enlarged)
    for cause, factor in _of_all_lengths(arm, own):
        scaled = [_scaled(pair, _everything(pair), factor) for pair in own]
        yield cause, (arm, joint, scaled)


Limits = tuple[float, float]


def _trials_of_urdf(arm: Arm, joint: int) -> Iterator[tuple[Cause, Limits]]:
    """Causes in a joint of a URDF, each with the limits [rad, m] that it would leave."""
    (lower, upper), at = arm.limits[joint], arm.joints[joint]
    if at.revolute and max(abs(lower), abs(upper)) > TURN:
        words = f"limits [{lower:g}, {upper:g}] rad look like degrees"
        remedy = f'write lower="{rounded(lower * deg)}" upper="{rounded(upper * deg)}"'
        yield Cause(path="limits", words=words, remedy=remedy), (lower * deg, upper * deg)
    axis, other = (" ".join(f"{sign * x + 0.0:g}" for x in at.axis) for sign in (1, -1))
    fits = f"with ({other}) the strokes fit its limits [{lower:g}, {upper:g}] {at.unit}"
    words = f"its axis ({axis}) looks reversed: {fits}"
    remedy = f'write <axis xyz="{other}"/>, or limits [{-upper:g}, {-lower:g}] {at.unit}'
    yield Cause(path="axis", words=words, remedy=remedy), (-upper, -lower)


def _trials_of_links(arm: Arm, joint: int) -> Iterator[tuple[Cause, Limits]]:
    """Causes in a joint of ``[links]``, each with the limits [rad, m] that it would leave."""
    (lower, upper), at = arm.limits[joint], arm.joints[joint]
    path = f"links.{arm.carried(joint)}"
    key, unit, other = ("limits_deg", deg, "radians") if at.revolute else ("limits_mm", mm, "m")
    given, meant, turned = (
        f"[{rounded(low)}, {rounded(high)}]"
        for low, high in (
            (lower / unit, upper / unit),
            (lower / unit**2, upper / unit**2),
            (-upper / unit, -lower / unit),
        )
    )
    if max(abs(lower), abs(upper)) / unit <= (TURN if at.revolute else LARGEST_ARM):
        cause = Cause(
            path=f"{path}.{key}",
            words=f"{given} looks like {other}",
            remedy=f"write {key} = {meant}",
        )
        yield cause, (lower / unit, upper / unit)
    axis, reverse = (", ".join(f"{sign * x + 0.0:g}" for x in at.axis) for sign in (1, -1))
    words = f"[{axis}] looks reversed: with [{reverse}] the strokes fit {key} = {given}"
    remedy = f"write axis = [{reverse}], or {key} = {turned}"
    yield Cause(path=f"{path}.axis", words=words, remedy=remedy), (-upper, -lower)


def _mirrored(own: Own) -> Iterator[tuple[Cause, Own]]:
    """The cause that a linkage is on its other side, and the cylinders with it there."""
    for i, (linkage, cylinder) in enumerate(own):
        if linkage.mirrored:
            key, given, other, mirrored = linkage.mirrored
            cause = Cause(
                path=f"cylinder.{cylinder.name}.{linkage.key}.{key}",
                words=f'"{given}" looks like the wrong side: with "{other}" the strokes fit',
                remedy=f'write {key} = "{other}"',
            )
            yield cause, [*own[:i], (mirrored, cylinder), *own[i + 1 :]]


def _of_all_lengths(arm: Arm, own: Own) -> Iterator[tuple[Cause, float]]:
    """The cause that all lengths of links or of cylinders are in another unit, and the factor.

    The factor is by which the cylinders, for a trial, become as large as the links. Nothing where
    they would be too large for any machine.
    """
    places = [link.translation for link in arm.links.values()]
    places += [joint.translation for joint in arm.joints]
    farthest = max(float(np.linalg.norm(place)) for place in places)
    if arm.of_links and farthest < SMALLEST_ARM:
        words = "its lengths look like metres beside the cylinders' lengths"
        yield Cause(path="links", words=words, remedy="write all of them in mm"), 1e-3
    elif farthest > LARGEST_ARM and not arm.of_links:
        words = "its lengths look like millimetres beside the cylinders' lengths"
        remedy = "a URDF is in metres: divide its lengths by 1000"
        yield Cause(path="urdf", words=words, remedy=remedy), 1e3
    elif max(cylinder.closed_length for _, cylinder in own) * 1e3 < LARGEST_ARM:
        words, remedy = "its lengths and pins look like metres", "write all of its lengths in mm"
        yield Cause(path=f"cylinder.{own[0][1].name}", words=words, remedy=remedy), 1e3


def _everything(pair: tuple[Linkage, Cylinder]) -> list[str]:
    return [*LENGTHS, *pair[0].places]


def _enlarged(own: Own, factor: float) -> Iterator[tuple[list[tuple[int, str]], Own]]:
    """Lengths or pins, one or several that go together, and the cylinders with them enlarged."""
    for i, pair in enumerate(own):
        pins, bars = pair[0].pin_names, pair[0].bar_names
        together = [names for names in ([*LENGTHS], bars, pins, [*pins, *bars]) if len(names) > 1]
        for names in ([name] for name in _everything(pair)), together:
            for chosen in names:
                enlarged = [*own[:i], _scaled(pair, chosen, factor), *own[i + 1 :]]
                if enlarged[i][1].stroke < enlarged[i][1].closed_length:
                    yield [(i, name) for name in chosen], enlarged


def _scaled(
    pair: tuple[Linkage, Cylinder], names: Iterable[str], factor: float
) -> tuple[Linkage, Cylinder]:
    """A cylinder with some of its lengths and places times a factor."""
    linkage, cylinder = pair
    for name in names:
        if key := LENGTHS.get(name):
            cylinder = dataclasses.replace(cylinder, **{key: factor * getattr(cylinder, key)})
        else:
            at = [factor * x for x in linkage.place(name) or ()]
            linkage = linkage.with_places({name: at})
    return linkage, cylinder


def _of_keys(own: Own, which: list[tuple[int, str]], unit: str, factor: float) -> Cause:
    """The cause that lengths or pins of cylinders are in another unit."""
    keys, now, then = list[str](), list[str](), list[str]()
    for i, name in which:
        linkage, cylinder = own[i]
        if name in LENGTHS:
            keys.append(f"cylinder.{cylinder.name}.{name}")
            values: tuple[float, ...] = (getattr(cylinder, LENGTHS[name]),)
        else:
            keys.append(f"cylinder.{cylinder.name}.{linkage.key_of(name)}")
            values = linkage.place(name) or ()
        for texts, unit_of_file in ((now, mm), (then, mm / factor)):
            text = ", ".join(rounded(value / unit_of_file) for value in values)
            texts.append(f"[{text}]" if len(values) > 1 else text)
    words = f"{' and '.join(now)} mm {'looks' if len(now) == 1 else 'look'} like {unit}"
    base = ".".join(keys[0].split(".")[:2]) + "."
    new = (f"{key.removeprefix(base)} = {text}" for key, text in zip(keys, then, strict=True))
    remedy, least = f"write {' and '.join(new)}", 0.0 if factor > 100 else BY_CHANCE
    return Cause(path=keys[0], words=words, remedy=remedy, least=least)
