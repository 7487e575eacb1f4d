"""Numbers by name: what maps, designs, validations and bandwidths come down to, in SI.

Columns of sweeps and ``numbers`` of ``--json`` are these.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armdesign.control.bandwidth_map import BandwidthMap
    from armdesign.design.design import Design
    from armdesign.frequency.maps import FrequencyMap
    from armdesign.machine.machine import Machine
    from armdesign.simulation.validation import Validation

Numbers = Mapping[str, Any]

BANDWIDTHS = ("bandwidth_before_hz", "bandwidth_of_best_frequency_hz", "bandwidth_after_hz")
MEANINGS = {
    "worst_hz": "worst natural frequency, sought between the poses of the workspace too, of all"
    " load cases [Hz]",
    "payload_at_worst": "load case of the worst pose",
    "cylinder_at_worst": "actuator or spring that limits the frequency at the worst pose",
    "<joint>_at_worst": "coordinate of a joint at the worst pose [rad or m]",
    "median_hz": "median over the workspace of the lowest natural frequency [Hz]",
    "most_often_limits": "actuator or spring that limits at the largest share of poses",
    "before_hz": "worst frequency of today's machine [Hz]",
    "after_hz": "worst frequency of the new machine [Hz]",
    "gain": "of the worst frequency, with the file's values; 0.1 is 10 %",
    "least_gain": "least gain within the bands, of the lowest of the poses, or gain where that is"
    " less; null without bands",
    "unrounded_hz": "worst frequency of the design before rounding [Hz]: where it was made for"
    " bands, within them; where for the least gain within them, that gain times before_hz",
    "bound_hz": "what no design of this kind exceeds, as unrounded_hz [Hz]; null where none is"
    " known",
    "gap": "share by which that bound lies above the design before rounding; 0.01 is 1 %",
    "least_of": "what --least made small: oil, flow or mass",
    "amount_before": "of today's machine: oil of all cap sides [m³], pump flow [m³/s], or mass of"
    " all cylinders [kg]",
    "amount_after": "the same of the new machine",
    "lift_share": "least lift of the new machine over today's, over the lift chart",
    "bandwidth_before_hz": "least bandwidth of today's machine, where it was the objective [Hz]",
    "bandwidth_of_best_frequency_hz": "least bandwidth with the highest worst frequency [Hz]",
    "bandwidth_after_hz": "least bandwidth of the new machine [Hz]",
    "binding": "requirement with the highest price; empty where none binds",
    "new.<key path>": "number of the new machine's file that differs from today's, in its unit",
    "worst_deviation": "largest deviation of identified from linear frequencies; 0.01 is 1 %",
    "runs": "number of nonlinear runs from which a frequency was identified",
    "failures": "number of nonlinear runs that failed",
    "linear_hz": "linear frequency of the lowest mode [Hz]; null, as the next three, where no"
    " run of it was fitted",
    "identified_hz": "frequency of the lowest mode in its nonlinear run [Hz]",
    "linear_damping": "linear damping ratio of the lowest mode",
    "identified_damping": "damping ratio of the lowest mode in its nonlinear run",
    "<scheme>_hz": "least bandwidth over the workspace of a kind of position loop [Hz]",
    "softest_hz": "lowest natural frequency of the map of bandwidths [Hz]",
    "softest_payload": "load case of that frequency",
    "workable_share": "share of the poses, under all load cases, at which a controller works:"
    " bandwidths are of these",
}


def of_map(frequencies: FrequencyMap) -> Numbers:
    """Worst frequency with its pose, and the median."""
    worst = frequencies.worst
    pose = zip(worst.joints, worst.q.tolist(), strict=True)
    return {
        "worst_hz": worst.frequency,
        "payload_at_worst": worst.payload,
        "cylinder_at_worst": worst.cylinder,
        **{f"{joint}_at_worst": value for joint, value in pose},
        "median_hz": float(frequencies.percentiles()["50 %"]["all"]),
        "most_often_limits": str(frequencies.limiting_shares.idxmax()),
    }


def of_design(design: Design) -> Numbers:
    """Worst frequency today and of the best machine, its gains, and every changed number."""
    from armdesign.machine.changes import numeric_changes

    before, after = design.before.worst.frequency, design.after.worst.frequency
    changed = numeric_changes(design.today, design.machine)
    return {
        "before_hz": before,
        "after_hz": after,
        "gain": design.gain,
        "least_gain": design.least_gain,
        "unrounded_hz": design.unrounded,
        "lift_share": design.lift_share,
        "binding": design.binding[0].name if design.binding else "",
        **dict(zip(BANDWIDTHS, design.bandwidths or (), strict=False)),
        **{f"new.{'.'.join(map(str, path))}": new for path, (_, new) in changed.items()},
    }


def names_of_changes(machines: Iterable[Machine]) -> tuple[str, ...]:
    """Names of answers that some designs have and others do not."""
    from armdesign.machine.file.numbers import numbers_of

    new = (f"new.{path}" for machine in machines for path in numbers_of(machine.section))
    return tuple(dict.fromkeys([*BANDWIDTHS, *new]))


def of_search(design: Design, least: str = "") -> Numbers:
    """A design, its bound, which takes seconds to find, and the amount that was made least."""
    from armdesign.design.least import amounts

    numbers = {**of_design(design), "bound_hz": design.bound, "gap": design.gap}
    if not least:
        return numbers
    before, after = amounts(design, least)
    return {**numbers, "least_of": least, "amount_before": before, "amount_after": after}


def of_validation(validation: Validation) -> Numbers:
    """Largest deviation of identified from linear frequencies, and of the lowest mode its run."""
    runs = validation.limiting.runs
    lowest = min(runs, key=lambda run: run.linear_frequency, default=None)
    return {
        "worst_deviation": validation.worst_deviation,
        "runs": len(validation.runs),
        "failures": len(validation.failures),
        "linear_hz": getattr(lowest, "linear_frequency", None),
        "identified_hz": getattr(lowest, "identified_frequency", None),
        "linear_damping": getattr(lowest, "linear_damping", None),
        "identified_damping": getattr(lowest, "identified_damping", None),
    }


def of_bandwidths(bandwidths: BandwidthMap) -> Numbers:
    """Least bandwidth of each kind of position loop, lowest frequency, share of poses."""
    from armdesign.control.bandwidth_map import SCHEMES

    softest = bandwidths.softest
    return {
        **{f"{scheme}_hz": float(bandwidths.worst(scheme)[f"{scheme}_hz"]) for scheme in SCHEMES},
        "softest_hz": float(softest["f1_hz"]),
        "softest_payload": str(softest["payload"]),
        "workable_share": float(bandwidths.frame["works"].mean()),
    }
