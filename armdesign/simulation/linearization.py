"""The plant linearised about operating points: ẋ = A x + B u, y = C x + D u, all poses at once.

With the machine's own terms, and h(q, q̇) Coriolis, centrifugal and gravity forces:

    M δq̈ = Rᵀ δF + (Σ F_i H_i − ∂h/∂q − diag(0, κ)) δq − (∂h/∂q̇ + diag(0, d)) δq̇ + Jᵀ f
    δℓ = R δq,   δℓ̇ = R δq̇ + (H q̇) δq,   δF, δṗ1, δṗ2 by ℓ, ℓ̇, p1, p2, spool, supply: ``slopes``

J is the Jacobian of the tool, f the force there. There is no term of ∂M/∂q: nothing accelerates at
an operating point. At rest it is equilibrium with all valves closed, or open just enough to make
up for leakage. Closed, a lapped valve passes no flow whatever the pressures, so it adds no
damping: what damps is leakage and viscous friction. Dry friction, which has no derivative at
standstill, is left out. The flow that a spool opens is larger to one side than to the other; A
holds the mean of both, and 0 within an overlap.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked
from armdesign.arrays import Array, Flags, chunks, stacked
from armdesign.errors import PoseError, SimulationError
from armdesign.machine.actuators import F, with_each
from armdesign.machine.dead_centres import dead_centre
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses, joint_positions, pose_text
from armdesign.mechanism.jets import VectorJet
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.simulation.linear_model import LinearModel, LinearModels
from armdesign.simulation.operating_point import (
    Openings,
    OperatingPoints,
    at_rest,
    in_motion,
    motion_of,
)
from armdesign.simulation.plant import slopes
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.rigid_bodies import COMPLEX_STEP, curvature
from armdesign.simulation.plant.springs import settled
from armdesign.simulation.signals import CHAMBERS, Signals, signals_of

WAY = 200  # poses on which a stable one is looked for


@checked
def linearize(
    machine: Machine,
    q: ArrayLike,
    *,
    opening: Openings = None,
    speed: ArrayLike | None = None,
    payload: str | float | None = None,
    preloaded: bool | None = None,
) -> LinearModel:
    """Linear model of the machine about one pose q (nq,).

    Args:
        machine: the machine.
        q: joint positions [rad, m].
        opening: spool positions −1…1 under which it moves steadily: by the actuators' names, or
            for all of them in order (nc,). Those that are not named, and 0, hold
            their load. None: rest.
        speed: joint speeds at which it moves steadily (nq,) [rad/s, m/s]. None: rest, or
            what the openings make.
        payload: name or mass [kg] of the load case; None: the one at work.
        preloaded: chamber pressures at equilibrium, as in ``simulate``.

    Raises:
        PoseError: the pose cannot be taken.
        SimulationError: a cylinder has no valve, a relief cannot hold its load, an opening is
            beyond ±1, pump, valves or vapour do not allow the motion, or trapped oil does not hold
            the pose; with the nearest thing that can be.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> model = ad.linearize(machine, [0.0])
        >>> print(model.natural_frequencies.round(2), model.states[:2])
        [10.77] ('boom position', 'boom velocity')
    """
    poses = joint_positions(machine, q)
    if len(poses) != 1:
        raise PoseError(f"{machine.name}: q", f"holds {len(poses)} poses", "give one")
    model: LinearModel = linear_models(
        machine, poses, opening=opening, speed=speed, payload=payload, preloaded=preloaded
    )[0]
    if not model.stable:
        raise _unstable(model.machine, poses[0])
    return model


def _unstable(machine: Machine, q: Array) -> SimulationError:
    """That trapped oil does not hold a pose (nq,), and the nearest one that it does hold.

    Looked for on the way to the middle of the joint ranges.
    """
    dead = dead_centre(machine, q)
    why = dead.fault if dead else "gravity overcomes it"
    fault = f"unstable on its trapped oil at {pose_text(machine, q)}: {why}"
    way = q + np.linspace(0, 1, WAY)[:, None] * (machine.ranges.mean(axis=1) - q)
    way = way[np.all(machine.margins(way) > 0, axis=1) & machine.holds(way)]
    held = way[_stable(machine.evaluate(machine.rigid_poses(way)))] if len(way) else way
    remedy = "choose a lighter load, or stiffer oil and structure"
    if len(held):
        nearest = pose_text(machine, held[0], decimals=2)
        remedy = f"the nearest stable pose towards mid range is {nearest}"
    return SimulationError(f"{machine.name}: operating point", fault, remedy)


@checked
def linear_models(
    machine: Machine,
    q: ArrayLike | RigidPoses,
    *,
    opening: Openings = None,
    speed: ArrayLike | None = None,
    payload: str | float | None = None,
    preloaded: bool | None = None,
) -> LinearModels:
    """Linear models of the machine about n poses at once.

    Args:
        machine: the machine.
        q: joint positions (n, nq) [rad, m], or this machine's bare links there.
        opening: spool positions −1…1 under which it moves steadily: by the actuators' names, or
            for all of them in order, (nc,) or (n, nc). Those that are not named, and 0, hold
            their load. None: rest.
        speed: joint speeds at which it moves steadily, (nq,) or (n, nq) [rad/s, m/s]. None: rest,
            or what the openings make.
        payload: name or mass [kg] of the load case; None: the one at work.
        preloaded: chamber pressures at equilibrium, as in ``simulate``.

    Raises:
        PoseError: a pose cannot be taken.
        SimulationError: a cylinder has no valve, a relief cannot hold its load, an opening is
            beyond ±1, or pump, valves or vapour do not allow the motion; with what they allow.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> models = ad.linear_models(machine, workspace.q)
        >>> print(*(model.natural_frequencies.round(2) for model in models))
        [7.45] [10.4] [16.63]
    """
    machine = machine if payload is None else machine.with_payload(payload)
    rigid = q if isinstance(q, RigidPoses) else machine.rigid_poses(q)
    if not len(rigid):
        raise PoseError(f"{machine.name}: q", "holds no pose", "give at least one")
    plant = Plant(without_dry_friction(settled(machine, rigid.q[0])))
    motion = motion_of(plant, len(rigid), opening, speed)

    def models(rows: slice) -> LinearModels:
        if motion is None:
            return assembled(plant, at_rest(plant, rigid[rows], preloaded))
        return assembled(plant, in_motion(plant, rigid[rows], motion.of(rows), preloaded))

    parts = (models(rows) for rows in chunks(len(rigid)))
    return replace(stacked(parts, len(rigid)), machine=machine)


def models_under(machine: Machine, q: Array, pressures: Array) -> LinearModels:
    """Linear models about rest at poses (n, nq) with other pressures (n, 2, nc) [Pa] than of rest.

    They hold the loads, too, as trapped oil does after a move.
    """
    plant = Plant(without_dry_friction(settled(machine, q[0])))
    point = at_rest(plant, machine.rigid_poses(q))
    states = plant.with_pressures(point.states, pressures)
    return replace(assembled(plant, point._replace(states=states)), machine=machine)


def without_dry_friction(machine: Machine) -> Machine:
    """The machine with viscous friction alone: dry friction has no derivative at rest."""

    def smooth(actuator: F) -> F:
        return replace(actuator, friction=replace(actuator.friction, coulomb=0.0, static=0.0))

    return with_each(machine, smooth)


def assembled(plant: Plant, point: OperatingPoints) -> LinearModels:
    """Linear models at operating points."""
    signals = signals_of(plant.machine)
    at = _At(plant, signals, point)
    size, nc, n = plant.size, plant.nc, len(at.states)
    a, b = np.zeros((n, size, size)), np.zeros((n, size, nc + 3))
    speeds = signals.states["speeds"]
    a[:, signals.states["positions"], speeds] = np.eye(plant.nq)
    a[:, speeds] = np.linalg.solve(point.poses.mass_matrix, at.generalised_force())
    b[:, speeds, nc:] = np.linalg.solve(point.poses.mass_matrix, at.tool.first)
    for group, rate in zip(CHAMBERS, at.instant.rates, strict=True):
        a[:, signals.states[group]] = at.by_states(rate)
    if plant.has_line:
        at.write_line(a)
    at.write_spools(a, b)
    c, d = at.outputs(a, b)
    return LinearModels(
        A=a,
        B=b,
        C=c,
        D=d,
        states=plant.state_names,
        inputs=signals.input_names,
        outputs=signals.output_names,
        state_groups=signals.states,
        input_groups=signals.inputs,
        output_groups=signals.outputs,
        equilibrium=at.states,
        capacities=at.instant.capacities,
        mass_matrix=point.poses.mass_matrix,
        tool_jacobian=np.swapaxes(at.tool.first, 1, 2),
        machine=plant.machine,
        stable=_stable(point.poses),
    )


def _stable(poses: Poses) -> Flags:
    """Whether trapped oil and springs hold each pose (n,): K ≻ 0."""
    return np.asarray(np.linalg.eigvalsh(poses.stiffness_matrix)[:, 0] > 0)


class _At:
    """Operating points, and what depends on them."""

    def __init__(self, plant: Plant, signals: Signals, point: OperatingPoints) -> None:
        self.plant, self.signals, self.point = plant, signals, point
        self.system, self.actuators = plant.parameters.systems[0], plant.parameters.actuators[0]
        self.states = point.states * plant.units
        self.velocity = self.states[:, signals.states["speeds"]]
        self.motion = self._motion()
        self.instant = slopes.actuate(self.actuators, self.system, self._numbers())
        self.tool = self._tool(self.states[:, signals.states["positions"]])

    def _tool(self, q: Array) -> VectorJet:
        """Motion of the tool at all coordinates (n, k)."""
        tool, arm = self.plant.machine.tool, self.plant.machine.arm
        joints, placed = tuple(range(self.plant.nq)), arm.kinematics(q)
        return arm.motion(placed, tool.link, np.array(tool.at), arm.root, joints)

    def _numbers(self) -> Array:
        """Length, its rate, pressures, spool and supply pressure of each actuator (n, nc, 6)."""
        poses, groups = self.point.poses, self.signals.states
        rates = (poses.moment_arms @ self.velocity[:, :, None])[..., 0]
        chambers = [self.states[:, groups[name]] for name in CHAMBERS]
        line = np.broadcast_to(self.system["pressure"], (len(rates), 1))
        line = self.states[:, groups["supply pressure"]] if self.plant.has_line else line
        supply = np.broadcast_to(line, rates.shape)
        spools = self.states[:, groups["spools"]]
        return np.stack([poses.lengths, rates, *chambers, spools, supply], axis=-1)

    def _motion(self) -> Array:
        """Derivatives of these numbers by the state (n, nc, 6, ns)."""
        poses, groups = self.point.poses, self.signals.states
        n, nc, _ = poses.moment_arms.shape
        motion, each = np.zeros((n, nc, slopes.NUMBERS, self.plant.size)), np.arange(nc)
        motion[:, :, slopes.LENGTH, groups["positions"]] = poses.moment_arms
        motion[:, :, slopes.RATE, groups["speeds"]] = poses.moment_arms
        bent = np.einsum("ncij,nj->nci", poses.moment_arm_derivatives, self.velocity)
        motion[:, :, slopes.RATE, groups["positions"]] = bent
        numbers = (slopes.CAP, slopes.ANNULUS, slopes.SPOOL)
        for number, group in zip(numbers, (*CHAMBERS, "spools"), strict=True):
            motion[:, each, number, groups[group].start + each] = 1.0
        motion[:, :, slopes.SUPPLY, groups["supply pressure"]] = 1.0
        return motion

    def by_states(self, slope: slopes.Slope) -> Array:
        """Derivatives of numbers of the actuators by the state (n, nc, ns)."""
        return np.asarray((slope.by[:, :, None] @ self.motion)[:, :, 0])

    def generalised_force(self) -> Array:
        """Derivative of all forces on the joints and springs by the state (n, k, ns)."""
        plant, poses, groups = self.plant, self.point.poses, self.signals.states
        force = np.swapaxes(poses.moment_arms, 1, 2) @ self.by_states(self.instant.force)
        bent = np.einsum("nc,ncij->nij", self.instant.force.value, poses.moment_arm_derivatives)
        stiffness, damping = _springs(plant.machine, poses)
        force[:, :, groups["positions"]] += bent - self.point.resistance_stiffness - stiffness
        force[:, :, groups["speeds"]] -= self.point.resistance_damping + damping
        return np.asarray(force)

    def write_line(self, a: Array) -> None:
        """Write the row of the supply pressure behind a pump of limited flow."""
        row, capacity = self.signals.states["supply pressure"].start, self.system["line_capacity"]
        a[:, row] = -self.by_states(self.instant.supplied).sum(axis=1) / capacity
        a[:, row, row] += slopes.pump(self.system, self.states[:, row])[1] / capacity

    def write_spools(self, a: Array, b: Array) -> None:
        """Write the rows of the spools, lags of second order; a command beyond ±1 is cut."""
        groups, nc = self.signals.states, self.plant.nc
        place, speed = groups["spools"], groups["spool speeds"]
        omega = 2 * np.pi * self.actuators["natural_frequency"]
        inside = np.heaviside(1 - np.abs(self.states[:, place]), 0.5)
        a[:, place, speed] = np.eye(nc)
        a[:, speed, place] = np.diag(-(omega**2))
        a[:, speed, speed] = np.diag(-2 * self.actuators["damping_ratio"] * omega)
        b[:, speed, self.signals.inputs["commands"]] = (inside * omega**2)[:, None] * np.eye(nc)

    def _swept(self) -> Array:
        """Derivative of the tool's acceleration at constant joint speeds by the state (n, 3, ns).

        By a complex step, exact to rounding.
        """
        swept = np.zeros((len(self.states), 3, self.plant.size))
        if not self.velocity.any():
            return swept
        groups, k = self.signals.states, self.plant.nq
        swept[:, :, groups["speeds"]] = 2 * np.einsum(
            "nkli,nl->nik", self.tool.second, self.velocity
        )
        q = self.states[:, groups["positions"]]
        for j in range(k):
            stepped = self._tool(q + COMPLEX_STEP * 1j * np.eye(k)[j])
            swept[:, :, groups["positions"].start + j] = (
                np.imag(curvature(stepped, self.velocity)) / COMPLEX_STEP
            )
        return swept

    def outputs(self, a: Array, b: Array) -> tuple[Array, Array]:
        """C and D."""
        states, rows = self.signals.states, self.signals.outputs
        c = np.zeros((len(a), len(self.signals.output_names), self.plant.size))
        d = np.zeros((len(a), len(self.signals.output_names), b.shape[2]))
        c[:, rows["piston positions"]] = self.by_states(self.instant.extension)
        c[:, rows["piston speeds"]] = self.by_states(self.instant.speed)
        same = {"joint positions": "positions", "joint speeds": "speeds"}
        for output, state in (same | dict(zip(CHAMBERS, CHAMBERS, strict=True))).items():
            c[:, rows[output], states[state]] = np.eye(states[state].stop - states[state].start)
        jacobian = np.swapaxes(self.tool.first, 1, 2)
        c[:, rows["tool position"], states["positions"]] = jacobian
        c[:, rows["tool acceleration"]] = jacobian @ a[:, states["speeds"]]
        c[:, rows["tool acceleration"]] += self._swept()
        d[:, rows["tool acceleration"]] = jacobian @ b[:, states["speeds"]]
        return c, d


def _springs(machine: Machine, poses: Poses) -> tuple[Array, Array]:
    """Stiffness and damping of the springs on all coordinates (k, k), (n, k, k).

    The damping differs by pose, d = 2 ζ √(K M), see ``Spring.settled``.
    """
    nq, k = len(machine.joints), poses.gravity_torque.shape[1]
    stiffness, damping = np.zeros((k, k)), np.zeros((len(poses), k, k))
    for j, spring in enumerate(machine.springs, start=nq):
        stiffness[j, j] = spring.stiffness
        own = np.maximum(poses.stiffness_matrix[:, j, j], 0.0) * poses.mass_matrix[:, j, j]
        damping[:, j, j] = 2 * spring.damping_ratio * np.sqrt(own)
    return stiffness, damping
