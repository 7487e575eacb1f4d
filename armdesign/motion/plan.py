"""Plans of moves that do not ring: ``plan_move``.

A move goes straight in joint space from pose to pose and rests at each. It is as fast as the
pump's flow, shared among all actuators, and the pressures allow (``path_limits``, ``time_law``);
its course is convolved with a shaper for the modes along the move (``way``, ``trajectory``), or
over all that may be met (``shapers``); spools are commanded so that the planned oil flows
(``compensation``). The commands are then run in the nonlinear simulation, with and without the
shaper, and with a heavier and a lighter payload than they were planned for (``outcome``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked, with_options
from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.machine.machine import Machine
from armdesign.machine.poses import joint_positions
from armdesign.motion.compensation import command_lead, compensated_commands
from armdesign.motion.feed_forward import spool_plan
from armdesign.motion.move import Move
from armdesign.motion.outcome import MoveRun, move_run, ring_time
from armdesign.motion.shapers import Shaper
from armdesign.motion.shaping import shaper_for
from armdesign.motion.spilling import refuse_spilling
from armdesign.motion.trajectory import Leg, fastest_leg, trajectory, within_flow
from armdesign.motion.way import WayModes, way_modes
from armdesign.simulation.plant.equilibrium import refuse_overcome
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.springs import settled as at_rest
from armdesign.simulation.simulate import SimulationCase, simulate_all
from armdesign.units import l_per_min, mm

# Shares of flow and force that a plan uses: the arm rings about it. The next where chambers jolt.
SHARES = (0.7, 0.5, 0.35)
SLOWEST, PATIENT = 30.0, 60.0  # times the shortest duration, or [s]: beyond both nothing rings
ROUNDING = 5e-3  # of a duration that is the shortest, as printed with three digits
TOLERANCE = 1e-6  # of the runs


class MoveOptions(TypedDict, total=False):
    """How a move is shaped, how fast it is, and under what it is tried."""

    shaper: str | Shaper
    modes: int | None
    damping: float | None
    duration: float | None
    share: float | None
    spread: float
    tolerance: float


USUAL_MOVE: MoveOptions = {
    "shaper": "zvd",
    "modes": None,
    "damping": None,
    "duration": None,
    "share": None,
    "spread": 0.2,
    "tolerance": 5 * mm,
}


@checked
@with_options(MoveOptions, USUAL_MOVE)
def plan_move(
    machine: Machine,
    start: ArrayLike,
    end: ArrayLike,
    *,
    payload: str | float | None = None,
    **options: Unpack[MoveOptions],
) -> Move:
    """Plan a move from pose to pose, and run it in the nonlinear simulation.

    Commands are computed for the machine's own load, oil and friction: each valve passes the oil
    of the planned piston speed under the pressures that the model has at that instant.

    Args:
        machine: the machine; every actuator needs a valve.
        start: joint positions (nq,) [rad, m].
        end: joint positions (nq,), or of several stops one after the other (k, nq) [rad, m].
        payload: a load case by name, or a mass [kg]; None: the machine's own.
        shaper: none, zv, zvd, ei: for the modes at the end, in whose phase the course is shaped
            all the way; band: for these modes over the whole way and all payloads tried;
            workspace: over the whole workspace and all load cases; or a ``Shaper`` of one's own.
        modes: how many of the lowest modes it is made for; None: those up to 4.5 times the
            lowest, as higher ones leave less than 5 % after the same step of acceleration.
        damping: ratio that it is made for; None: of each linear mode at the end.
        duration: without the shaper's delay [s], up to 60 or 30 times the shortest; None: that.
        share: of the pump's flow and of the force that pressures leave, that is used. None: 0.7,
            or less where chambers that run empty and fill again on the way leave more than 5 % of
            the unshaped (``Move.jolts``), which no shaper foresees.
        spread: payloads this share lighter and heavier are tried, too; 0: none.
        tolerance: distance within which the tool has settled [m].

    Raises:
        ArmDesignError: an option out of its range, or a move faster than pump, valves and
            pressures allow, or much slower, with the duration that can be.
        PoseError: a pose that cannot be taken, or one that does not hold the load case.
        SimulationError: a valve is missing, or a run gives up.

    Example:
        >>> import armdesign as ad
        >>> machine, up = ad.load("excavator_20t"), [(0.0, -1.6, -1.2), (0.3, -1.6, -1.2)]
        >>> move = ad.plan_move(machine, *up, payload="full", spread=0.0)
        >>> move.shaped.residual < 0.05 * move.unshaped.residual
        True
    """
    duration, share, tolerance = options["duration"], options["share"], options["tolerance"]
    shares = SHARES[: None if duration is None else 1] if share is None else (share,)
    _refuse_options(machine, shares[0], options)
    model = machine if payload is None else machine.with_payload(payload)
    poses = np.vstack([joint_positions(model, start), joint_positions(model, end)])
    refuse_spilling(model, poses)
    refuse_overcome(Plant(at_rest(model, poses[0])), model.at(poses))
    masses = _masses(model, options["spread"])

    def planned(share: float) -> Move:
        fastest = [fastest_leg(model, *pair, share) for pair in pairwise(poses)]
        if duration is not None:
            _refuse_longer(model, fastest, duration)
        way = way_modes(model, _lasting(fastest, duration))
        shaper, paces = options["shaper"], None
        if isinstance(shaper, str):
            modes, damping = options["modes"], options["damping"]
            shaper, paces = shaper_for(shaper, way, masses, modes, damping)
        fastest = within_flow(fastest, shaper, paces)
        if duration is not None:
            _refuse_shorter(model, fastest, duration, share)
        way = way._replace(legs=_lasting(fastest, duration))
        move = _move(way, poses, shaper, paces, share, _duration(fastest))
        return replace(move, tolerance=tolerance, runs=_runs(move, masses, tolerance))

    return _calmest(planned, shares)


def _calmest(planned: Callable[[float], Move], shares: Sequence[float]) -> Move:
    """The move of the first share without jolts, or else the one that leaves least."""
    moves: list[Move] = []
    for share in shares:
        moves.append(planned(share))
        if not moves[-1].jolts:
            break
    best = min(moves, key=lambda move: max(move.reductions))
    return replace(best, faster=None if best is moves[0] else moves[0])


def _refuse_options(machine: Machine, share: float, options: MoveOptions) -> None:
    """Refuse a share and options out of their range, with the nearest value that works."""
    spread, near, modes = options["spread"], options["tolerance"], options["modes"]
    damping = 0.0 if options["damping"] is None else options["damping"]
    duration = math.inf if options["duration"] is None else options["duration"]
    near_share, near_spread = (1 if share > 1 else 0.01), (0.9 if spread >= 1 else 0)
    for name, value, inside, allowed, remedy in (
        (
            "share",
            share,
            0.01 <= share <= 1,
            "[0.01, 1]",
            f"{near_share}, as --share {near_share}",
        ),
        ("spread", spread, 0 <= spread < 1, "[0, 1)", f"{near_spread}, as --spread {near_spread}"),
        ("damping", damping, 0 <= damping < 1, "[0, 1)", "0.02, as --damping 0.02"),
        ("tolerance", near, 0 < near < math.inf, "(0, inf) m", "a distance, as tolerance=0.005"),
        ("duration", duration, duration > 0, "(0, inf) s", "a time, as --duration 5"),
    ):
        if not inside:
            fault = f"{value:g} is not in {allowed}"
            raise ArmDesignError(f"{machine.name}: move: {name}", fault, f"give {remedy}")
    most = len(machine.arm.coordinates)
    if modes is not None and not 1 <= modes <= most:
        near = max(1, min(modes, most))
        fault = f"{modes} is not allowed: the machine has {most}"
        raise ArmDesignError(f"{machine.name}: move: modes", fault, f"give {near}")


def _refuse_longer(machine: Machine, legs: Sequence[Leg], duration: float) -> None:
    """Raise for a duration [s] so long that it is of no use."""
    shortest = _duration(legs)
    longest = max(SLOWEST * shortest, PATIENT)
    if duration > longest:
        fault = f"{duration:.3g} s is more than {SLOWEST:g} times the shortest, {shortest:.3g} s"
        remedy = f"give {math.floor(longest):g} s or less: so slow a move does not ring"
        raise ArmDesignError(f"{machine.name}: move: duration", fault, remedy)


def _refuse_shorter(machine: Machine, legs: Sequence[Leg], duration: float, share: float) -> None:
    """Raise for a duration [s] that is shorter than that of legs within flow and pressures."""
    shortest = _duration(legs)
    if duration < shortest * (1 - ROUNDING):
        flow = f"{machine.supply.flow / l_per_min:.4g} l/min, its valves and pressures"
        fault = f"{duration:.3g} s is faster than {share:g} of the pump's {flow} allow"
        more = " or, up to 1, a larger --share (in Python share)" if share < 1 else ""
        remedy = f"give {math.ceil(100 * shortest) / 100:.2f} s or more{more}"
        raise ArmDesignError(f"{machine.name}: move: duration", fault, remedy)


def _lasting(legs: Sequence[Leg], duration: float | None) -> list[Leg]:
    """The legs, together of a duration [s] if they are shorter; None: as they are."""
    factor = 1.0 if duration is None else max(duration / _duration(legs), 1.0)
    return [leg.stretched(factor) for leg in legs]


def _duration(legs: Sequence[Leg]) -> float:
    return sum(leg.law.duration for leg in legs)


def _masses(machine: Machine, spread: float) -> tuple[float, ...]:
    """Masses of the payload that are tried [kg], the planned one first."""
    mass = machine.payload.mass
    return (mass, (1 - spread) * mass, (1 + spread) * mass) if mass and spread else (mass,)


def _move(
    way: WayModes, poses: Array, shaper: Shaper, paces: Array | None, share: float, shortest: float
) -> Move:
    """The move without runs."""
    model, legs = way.machine, way.legs
    both = [trajectory(legs, Shaper.none()), trajectory(legs, shaper, paces)]
    plans = [spool_plan(model, one.q, one.velocity, one.acceleration) for one in both]
    commands = compensated_commands(model, both, plans)
    return Move(
        machine=model,
        poses=poses,
        shaper=shaper,
        frequencies=way.end,
        empty=way.empty,
        share=share,
        shortest=shortest,
        duration=both[0].duration,
        lead=command_lead(model),
        planned=both[1],
        plan=plans[1],
        commands=commands[1],
        unshaped_commands=commands[0],
        tolerance=0.0,
        runs=(),
    )


def _runs(move: Move, masses: Sequence[float], tolerance: float) -> tuple[MoveRun, ...]:
    """Nonlinear runs without and with shaper under every mass of the payload."""
    lowest = float(move.frequencies[0])
    after = ring_time(move.machine, lowest)
    pairs = ((move.unshaped_commands, move.lead + move.duration), (move.commands, move.stop_time))
    cases = [
        SimulationCase(machine=model, q=move.poses[0], command=command, duration=end + after)
        for model in (move.machine, *map(move.machine.with_payload, masses[1:]))
        for command, end in pairs
    ]
    return tuple(
        move_run(run, bool(k % 2), pairs[k % 2][1], lowest, tolerance, move.poses[-1])
        for k, run in enumerate(simulate_all(cases, tolerance=TOLERANCE))
    )
