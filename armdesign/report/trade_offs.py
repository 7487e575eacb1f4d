"""Sheets of trade-offs: under one limit after another, and of few moving pins."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from armdesign.report.maps import in_hertz
from armdesign.report.sheet import Sheet
from armdesign.units import WORKSHOP, Units, percent

if TYPE_CHECKING:
    from armdesign.design.design import Design
    from armdesign.design.pareto import Pareto
    from armdesign.design.steps import DesignStep, Steps

BUILT_SETS = "all sets with free sizes; the best are built, and those that no bound rules out"
SHARES = {  # of today's, by column of a trade-off: its head, and in words
    "oil_share": ("oil", "oil"),
    "thrust_share": ("thrust", "largest thrust"),
    "digging_share": ("digging", "least digging torque"),
    "lift_share": ("lift", "least lift of all points of the lift chart"),
}


def pareto_sheet(front: Pareto, units: Units = WORKSHOP) -> Sheet:
    """Best designs of a trade-off, a row for each limit, relative to today's machine."""
    names = [name for name in SHARES if name in front.frame and front.frame[name].notna().any()]
    banded = ("banded_hz", "least_gain") if front.robust else ()
    shown = ("frequency_hz", "gain", *banded, *names, "squared_times_speed")
    texts: dict[str, Callable[[float], str]] = {"gain": percent, "least_gain": percent}
    texts |= {"frequency_hz": in_hertz, "banded_hz": in_hertz, "squared_times_speed": _ratio}
    first = front.designs[0]
    known = {"frequency_hz": first.before.worst.frequency}
    if front.robust:
        known["banded_hz"] = first.band_before.low.frequency
    rows = [("today", *(texts[name](known[name]) if name in known else "" for name in shown))]
    of_limit = "{:g}".format if front.against != "pin_box" else partial(units.text, unit="m")
    for row in front.frame.to_dict("records"):
        cells = (texts.get(name, "{:.3f}".format)(row[name]) for name in shown)
        rows.append((of_limit(row["limit"]), *cells))
    columns = ["limit", "frequency", "gain", *front.robust * ["in the bands", "least gain"]]
    columns += [*(SHARES[name][0] for name in names), "f² × speed"]
    quantities = f"{', '.join(SHARES[name][1] for name in names)} and f² × speed"
    each = "; oil of each cylinder side at most 1.1 × the limit" if front.against == "oil" else ""
    return Sheet(
        title=(
            f"{front.today.section.title or front.today.name}: worst natural frequency against"
            f" {front.against}"
        ),
        columns=tuple(columns),
        rows=tuple(rows),
        note="; ".join([f"{quantities} relative to today's{each}", *front.sentences]),
    )


def _ratio(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "–"


def steps_sheet(answer: Steps) -> Sheet:
    """The best design for each number of pins that move."""
    today, first = answer.today, answer.steps[0].design
    rows = [("today", in_hertz(first.before.worst.frequency), *5 * ("",))]
    for step in answer.steps:
        rows.append(
            (
                str(len(step.pins)),
                in_hertz(step.design.after.worst.frequency),
                percent(step.gain),
                "" if math.isnan(step.design.lift_share) else f"{step.design.lift_share:.2f}",
                ", ".join(step.changed),
                f"{step.searched} of {step.sets}",
                _proved(step),
            )
        )
    gain, of = "least gain", ", least gain within the bands"
    if not answer.robust:
        gain, of = "gain", ", for which alone the designs were made"
    notes = [
        f"worst frequency at the file's values{of}; least lift over today's of all points of the"
        " lift chart"
    ]
    notes.append(
        "searched: sets of so many pins, from today's pins, from the best with one pin less and,"
        " where starts ask for them, from drawn ones;"
        f" proved: other sets of which no {_bounded(first)} gains more than what is reached here,"
        " by an upper bound, and by how much at most one of the rest might"
    )
    notes += [_left_open(step) for step in answer.steps if 0 < step.excess < math.inf]
    if any(step.searched < step.sets for step in answer.steps):
        notes.append("of too many sets those were searched that add a pin to the step before")
    if max(step.built for step in answer.steps) > 1:
        notes.append(f"{BUILT_SETS}, and the best of these is the answer")
    return Sheet(
        title=f"{today.section.title or today.name}: which change first",
        columns=("pins that move", "worst", gain, "least lift", "changed", "searched", "proved"),
        rows=tuple(rows),
        note="; ".join([*notes, *answer.sentences]),
        words=("changed",),
    )


def _bounded(design: Design) -> str:
    """What bounds on sets of pins are of."""
    return "machine that can be built" if design.problem.grid.sizes else "design"


def _left_open(step: DesignStep) -> str:
    """Sets that no bound rules out, and by how much at most each might be better."""
    sets = ", ".join(
        f"{' + '.join(_words(path) for path in some)} {percent(excess, 2)}"
        for some, excess in (step.open_sets or {}).items()
    )
    return f"left open of {len(step.pins)} pins: {sets}"


def _words(path: str) -> str:
    """A pin's words: "boom base" of "cylinder.boom.base"."""
    return " ".join(path.split(".")[1:]).replace("_", "-")


def _proved(step: DesignStep) -> str:
    """How many other sets are proved to hold nothing better, and what is not ruled out."""
    if step.sets == 1:
        return ""
    left = f"; {percent(step.excess, 2)}" if 0 < step.excess < math.inf else ""
    return f"{step.proved} of {step.sets - 1}{left}"
