"""Plant of the loops: the arm, from demanded piston speeds to positions and load pressures.

A controller demands a speed v_i of each piston; the static gain of its valve at rest (piston speed
by spool position at constant force) makes a spool command of it. An extending and a retracting
piston have gains of their own, which a controller knows, so that in demanded speeds the valve is
the same on both sides. Between demand and valve lie the spool's dynamics and, if stated, a delay:
of the controller, the bus, the pilot stage.

The load pressure is p_L = (A1 p1 − A2 p2)/A1, the force over the bore.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Flags, ReadOnly
from armdesign.control.stated_damping import (
    checked_damping,
    controllable,
    modal_damping,
    refuse_undamped,
)
from armdesign.errors import ArmDesignError
from armdesign.frequency.modes import natural_modes
from armdesign.hydraulics.actuator import SIDES, areas_of
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses
from armdesign.simulation.damped_modes import fastest_poles
from armdesign.simulation.linear_model import LinearModels
from armdesign.simulation.linearization import linear_models
from armdesign.simulation.plant import slopes
from armdesign.simulation.plant.hydraulics import actuators_of, system_of
from armdesign.units import bar, ms, outward

INDEPENDENT = 1e9  # condition of eigenvectors that lose no more than half of the digits
LEAKING = 1e-4  # [ω_1] of leaking oil, whose pressures drift within hours
CREEPING = 2.0  # times the rate at which pressures creep apart with no loop closed
LAGGING = 0.1  # rad, by which a delay lags where loops are still lags
LONGEST = 30.0  # periods of the lowest mode in a delay: beyond, pressures creep as fast as loops
BESIDE = 1e-9  # spool position by which one side of the middle is told from the other
AT_ONCE = 30_000  # frequencies, of all poses: their matrices stay below 100 MB


@dataclass(frozen=True, eq=False, kw_only=True)
class LoopPlant(ReadOnly):
    """The plant of the loops at n poses of a machine with nq joints and nc actuators.

    States: positions and speeds of joints and springs, chamber pressures [bar], line pressure.

    Attributes:
        q: joint positions (n, nq) [rad, m].
        A: (n, ns, ns).
        B: by the speeds of the pistons that the openings of the valves stand for (n, ns, nc).
        load: to the load pressures [bar] (nc, ns).
        moment_arms: R (n, nc, nq) [m/rad].
        oil_stiffness: of each actuator with compliance (n, nc) [N/m].
        areas: bore areas (nc,) [m²].
        frequencies: of the modes, ascending (n, k) [Hz].
        damping: damping ratios of the modes (n, k).
        valve_omega: natural frequencies of the spools (nc,) [rad/s].
        valve_damping: their damping ratios (nc,).
        sides: spool that a demand to extend and one to retract gets, over the mean (n, nc, 2).
        delay: between demand and spool [s].
    """

    q: Array
    A: Array
    B: Array
    load: Array
    moment_arms: Array
    oil_stiffness: Array
    areas: Array
    frequencies: Array
    damping: Array
    valve_omega: Array
    valve_damping: Array
    sides: Array
    delay: float

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: slice | Array) -> LoopPlant:
        """The plants of some of the poses (slice, mask or indices)."""
        shared = {"load", "areas", "valve_omega", "valve_damping", "delay"}
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        picked = {name: value[rows] for name, value in values.items() if name not in shared}
        some = LoopPlant(**{**values, **picked})
        for name in {"_eigen", "_modal"} & vars(self).keys():  # are not computed again
            vars(some)[name] = tuple(each[rows] for each in getattr(self, name))
        if "_defective" in vars(self):
            vars(some)["_defective"] = self._defective[rows]
        return some

    @property
    def joints(self) -> int:
        """Number of joints."""
        return self.q.shape[1]

    @property
    def slowest(self) -> Array:
        """Frequency (n,) [rad/s] of the lowest mode, or of a valve that is slower."""
        return np.minimum(self.omega, self.valve_omega.min())

    @property
    def fastest(self) -> Array:
        """Frequency (n,) [rad/s] beyond which loops answer little: of modes and valves."""
        highest = 2 * math.pi * self.frequencies[:, -1]
        return np.maximum(highest, 0.5 * self.valve_omega.max())

    @property
    def band(self) -> tuple[Array, Array]:
        """Frequencies (n,), (n,) [rad/s] below which loops are lags, and beyond which small."""
        low = np.minimum(0.03 * self.slowest, 0.3 * self.damping[:, 0] * self.omega)
        if self.delay:
            low = np.minimum(low, LAGGING / self.delay)
        return low, 3 * self.fastest

    @cached_property
    def omega(self) -> Array:
        """Lowest natural frequency (n,) [rad/s]."""
        return np.asarray(2 * math.pi * self.frequencies[:, 0])

    @cached_property
    def creep(self) -> Array:
        """Rate (n,) [1/s] at which pressures creep apart of themselves, no loop closed; ≥ 0.

        Oil that leaks past a piston at rest raises the pressure of both chambers. With air it is
        the stiffer the higher they are, so that they rise ever faster: a pole to the right, within
        a quarter of an hour or more, that moves nothing.
        """
        return np.asarray(self._eigen[0].real.max(axis=1).clip(0.0))

    @cached_property
    def fastest_creep(self) -> Array:
        """Real part of poles (n,) [1/s] up to which pressures creep: no loop is the cause."""
        return np.asarray(LEAKING * self.omega + CREEPING * self.creep)

    def valve(self, s: Array) -> Array:
        """Response of spool and delay (…, nc) at complex frequencies s (…) [rad/s]."""
        return np.asarray(self.spool(s) * np.exp(-self.delay * np.asarray(s)[..., None]))

    def spool(self, s: Array) -> Array:
        """Response of the spools (…, nc) at complex frequencies s (…) [rad/s]."""
        omega, s = self.valve_omega, np.asarray(s)[..., None]
        return np.asarray(omega**2 / (s**2 + 2 * self.valve_damping * omega * s + omega**2))

    @cached_property
    def _modal(self) -> tuple[Array, Array, Array]:
        """Poles (n, ns), outputs by modal states (n, nq + nc, ns), these by v (n, ns, nc)."""
        poles, eigenvectors = self._eigen
        eigenvectors = np.where(self._defective[:, None, None], np.eye(len(poles.T)), eigenvectors)
        seen = self._outputs @ eigenvectors
        return poles, seen, np.linalg.solve(eigenvectors, self.B.astype(complex))

    @cached_property
    def _defective(self) -> Flags:
        """Poses whose A has hardly independent eigenvectors (n,)."""
        return np.asarray(np.linalg.cond(self._eigen[1]) > INDEPENDENT)

    @cached_property
    def _eigen(self) -> tuple[Array, Array]:
        """Poles (n, ns) and right eigenvectors (n, ns, ns)."""
        poles, eigenvectors = np.linalg.eig(self.A)
        return poles, eigenvectors

    @property
    def _outputs(self) -> Array:
        """Joint positions and load pressures by states (nq + nc, ns)."""
        return np.concatenate([np.eye(self.joints, self.A.shape[1]), self.load])

    def response(self, omega: Array) -> tuple[Array, Array]:
        """Joint positions (n, nq, nc, f) and load pressures [bar] (n, nc, nc, f) by demands.

        Args:
            omega: frequencies of each pose (n, f) [rad/s].
        """
        (n, f), (poles, outputs, inputs) = omega.shape, self._modal
        residues = outputs[:, :, None] * np.swapaxes(inputs, 1, 2)[:, None]
        response = np.empty((*residues.shape[:3], f), complex)
        step = max(AT_ONCE // max(f, 1), 1)
        for begin in range(0, n, step):
            rows = slice(begin, begin + step)
            resolvent = 1 / (1j * omega[rows, None] - poles[rows, :, None])
            by_mode = residues[rows].reshape(len(resolvent), -1, poles.shape[1])
            response[rows] = (by_mode @ resolvent).reshape(response[rows].shape)
        for pose in np.flatnonzero(self._defective):
            matrix = 1j * omega[pose, :, None, None] * np.eye(self.A.shape[1]) - self.A[pose]
            states = np.linalg.solve(matrix, self.B[pose].astype(complex))
            response[pose] = np.moveaxis(self._outputs @ states, 0, -1)
        response *= np.swapaxes(self.valve(1j * omega), 1, 2)[:, None]
        moved, pressed = np.split(response, [self.joints], axis=1)
        return np.ascontiguousarray(moved), np.ascontiguousarray(pressed)


def loop_plant(
    machine: Machine, poses: Poses, damping: float | None = None, delay: float = 0.0
) -> LoopPlant:
    """The plant of the loops at poses at which the machine can work, see ``workable``.

    Args:
        machine: with its load case at work.
        poses: of it.
        damping: ratio of all modes in place of the file's damping; None: the file's.
        delay: between demand and spool [s].

    Raises:
        ArmDesignError: a mode is not damped, or a delay or damping ratio cannot be.
        SimulationError: an actuator has no valve.
    """
    ratio = checked_damping(damping)
    if not 0 <= delay < math.inf:
        remedy = "give one as --delay 20 (in Python and studies delay = 0.02)"
        raise ArmDesignError("delay", f"{delay / ms:g} ms is not a time of 0 ms or more", remedy)
    models = linear_models(controllable(machine, ratio is not None), poses.q)
    matrices = models.state_matrix_in_bar
    modes, k, nc = natural_modes(poses), poses.mass_matrix.shape[1], len(machine.actuators)
    rows, areas = slice(k, 2 * k), areas_of(machine.actuators)
    A = np.array(matrices[:, : -2 * nc, : -2 * nc])
    if ratio is not None:
        A[:, rows, rows] -= modal_damping(poses, modes, ratio)
        frequencies, ratios = modes.frequencies, np.full(modes.frequencies.shape, ratio)
    else:
        poles = fastest_poles(A, k)
        frequencies, ratios = np.abs(poles) / (2 * math.pi), -poles.real / np.abs(poles)
        refuse_undamped(machine, ratios, poses.q)
    load = _load_pressures(areas, A.shape[1], 2 * k)
    force = load * areas[:, :1] * bar
    by_spool = matrices[:, : -2 * nc, -2 * nc : -nc]
    arms = poses.moment_arms
    # Ḟ = f x − k ℓ̇: at constant force the piston moves with f/k for each unit of the spool.
    stiffness = -((force @ A)[:, :, rows] * arms).sum(axis=2) / (arms**2).sum(axis=2)
    gains = np.einsum("cs,nsc->nc", force, by_spool) / stiffness
    valves = [actuator.valve for actuator in machine.actuators if actuator.valve]
    return LoopPlant(
        q=poses.q,
        A=A,
        B=by_spool / gains[:, None],
        load=load,
        moment_arms=arms[:, :, : poses.q.shape[1]],
        oil_stiffness=stiffness,
        areas=areas[:, 0],
        frequencies=frequencies,
        damping=ratios,
        valve_omega=2 * math.pi * np.array([valve.natural_frequency for valve in valves]),
        valve_damping=np.array([valve.damping_ratio for valve in valves]),
        sides=_sides(models),
        delay=float(delay),
    )


def _sides(models: LinearModels) -> Array:
    """Spools that equal demands to extend and to retract get at rest, over the mean (n, nc, 2)."""
    actuators, system = actuators_of(models.machine), system_of(models.machine).reshape(1)[0]
    groups, rest = models.state_groups, models.equilibrium
    pressures = [rest[:, groups[f"{side} pressures"]] for side in SIDES]
    spools, line = rest[:, groups["spools"]], rest[:, groups["supply pressure"]]
    none = np.zeros_like(spools)
    supply = none + (line if line.size else system["pressure"])
    shares = actuators["areas"].T[:, None] / np.swapaxes(models.capacities, 0, 1)
    gains = []
    for moved in (spools + BESIDE, spools - BESIDE):
        own = slopes.independent(np.stack([none, none, *pressures, moved, supply], axis=-1))
        flows = [slopes.port(actuators, system, i, own)[0].by[..., slopes.SPOOL] for i in (0, 1)]
        gains.append(np.abs(shares[0] * flows[0] + shares[1] * flows[1]))
    both = np.maximum(np.stack(gains, axis=-1), np.finfo(float).tiny)
    return np.asarray(both.mean(axis=-1, keepdims=True) / both)


def refuse_long(delay: float, lowest: float, machine: Machine) -> None:
    """Refuse a delay [s] of so many periods of the lowest mode [Hz] that no controller is of use.

    Raises:
        ArmDesignError: such a delay, with the longest that is allowed.
    """
    if LONGEST / lowest < delay < math.inf:
        longest = outward(LONGEST / lowest / ms, 3, up=False)
        fault = (
            f"{delay / ms:g} ms are {delay * lowest:.0f} periods of the lowest mode,"
            f" {lowest:.3g} Hz"
        )
        remedy = f"give {longest:g} ms or less (in Python delay={longest * ms:g})"
        raise ArmDesignError(f"{machine.name}: delay", fault, remedy)


def workable(machine: Machine, poses: Poses) -> Flags:
    """Whether a controller can work at each pose (n,): stable, and held below supply and reliefs.

    Raises:
        SimulationError: an actuator has no valve.
    """
    actuators_of(machine)
    works = natural_modes(poses).frequencies[:, 0] > 0
    for actuator, force in zip(machine.actuators, poses.cylinder_forces.T, strict=True):
        pressures = np.max(actuator.static_pressures(force, machine.supply), axis=0)
        works &= pressures < actuator.available_pressure(machine.supply)
    return np.asarray(works)


def _load_pressures(areas: Array, size: int, first: int) -> Array:
    """Rows p1 − (A2/A1) p2 (nc, size) of states whose pressures begin at ``first``."""
    nc = len(areas)
    rows, each = np.zeros((nc, size)), np.arange(nc)
    rows[each, first + each] = 1.0
    rows[each, first + nc + each] = -areas[:, 1] / areas[:, 0]
    return rows
