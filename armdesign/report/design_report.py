"""The report of a design: what one signs, archives and repeats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.design.provenance import stated_requirements
from armdesign.errors import ArmDesignError
from armdesign.report.bandwidths import bandwidth_sheets
from armdesign.report.comparison import Comparison
from armdesign.report.contents import Picture, Report, ReportSection
from armdesign.report.designs import (
    bands_of_design,
    bandwidth_sheet,
    binding_sheet,
    bound_sheet,
    gain_sheet,
    sizes_sheet,
    summary,
)
from armdesign.report.lift_charts import lift_charts, lift_sheet
from armdesign.report.loads import loads_sheet
from armdesign.report.map_reports import assumptions, headline, least_between, poses_of_ends
from armdesign.report.maps import spread_sheet
from armdesign.report.performance import performance_sheet
from armdesign.report.provenance import Origin
from armdesign.report.scene import scene_of
from armdesign.report.sheet import Sheet
from armdesign.report.validations import validation_sheet, verdict
from armdesign.units import WORKSHOP, Units

if TYPE_CHECKING:
    from armdesign.design.design import Design
    from armdesign.frequency.maps import FrequencyMap
    from armdesign.simulation.validation import Validation


def design_report(
    design: Design,
    proofs: Mapping[str, Validation],
    pictures: Sequence[Picture],
    origin: Origin,
    units: Units = WORKSHOP,
) -> Report:
    """Report of a design.

    Args:
        design: the new machine.
        proofs: nonlinear runs of today's and the new machine.
        pictures: files of its folder.
        origin: how it was made.
        units: of the tables.
    """
    maps = {"today": design.before, "new": design.after}
    of = {name: tuple(p for p in pictures if p.file.startswith(name)) for name in PICTURES}
    pairs = poses_of_ends(maps, design.bands, (design.band_before, design.band_after))
    lead = f"{summary(design)}{least_between(pairs, design.least_gain)}"
    return Report(
        title=f"{design.today.section.title or design.today.name}: new cylinders and pins",
        lead=f"{lead} In nonlinear simulation, {verdict(list(proofs.values()))}.",
        headline=headline(pairs, design.today, design.bands, units),
        sections=(
            ReportSection(title="The machine, today and new", shows="drawing"),
            ReportSection(
                title="Maps before and after",
                shows="maps",
                pictures=of["map"],
                sheets=(
                    *filter(None, [bandwidth_sheet(design)]),
                    gain_sheet(design, units),
                    bands_of_design(design),
                    spread_sheet(maps),
                ),
            ),
            _buyer(design, of["lift"], units),
            _changes(design, of["moment"], units),
            ReportSection(
                title="Binding requirements and their prices",
                sheets=(binding_sheet(design, units),),
            ),
            ReportSection(title="Bound and gap", sheets=(bound_sheet(design),)),
            bandwidth_section(design, units),
            _validation(proofs, of["frequency"]),
            ReportSection(title="Assumptions", words=_assumptions(design)),
            ReportSection(title="Provenance", sheets=(_provenance(design, origin),)),
        ),
        scene=scene_of(maps, units),
    )


PICTURES = ("map", "lift", "moment", "frequency")  # how files of pictures begin
BANDWIDTHS = 24  # poses at which bandwidths are computed: about 1 s for each machine


def _buyer(design: Design, pictures: Sequence[Picture], units: Units) -> ReportSection:
    """Section for a buyer: lift chart, digging force, stroke times."""
    machines = {"today": design.today, "new": design.machine}
    both = {label: (machine, design.workspace) for label, machine in machines.items()}
    return ReportSection(
        title="What the buyer sees",
        pictures=tuple(pictures),
        sheets=(
            lift_sheet(lift_charts(machines), units),
            loads_sheet(both, design.requirements.digging, units),
            performance_sheet(machines, units),
        ),
    )


def _changes(design: Design, pictures: Sequence[Picture], units: Units) -> ReportSection:
    differences = Comparison({"today": design.before, "new": design.after})
    return ReportSection(
        title="Changes",
        pictures=tuple(pictures),
        sheets=(sizes_sheet(design, units), differences.differing()),
    )


def bandwidth_section(design: Design, units: Units) -> ReportSection:
    """Bandwidths at poses of the workspace, the same for both machines: all take minutes."""
    from armdesign.control.bandwidth_map import bandwidth_map

    title, maps, both = "Bandwidth of position loops", {}, (design.before, design.after)
    poses = design.workspace.subset(bandwidth_rows(both))
    for label, one in zip(("today", "new"), both, strict=True):
        try:
            maps[label] = bandwidth_map(one.machine, poses)
        except ArmDesignError as error:
            return ReportSection(title=title, words=(f"Not known: {error}.",))
    words = (
        f"Worst and median of {len(poses)} of the workspace's {len(design.workspace)} poses, in"
        " every load case: those with the lowest frequency of each machine, and others drawn at"
        " random; armdesign control maps the workspace.",
    )
    reached, *_, promised = bandwidth_sheets(maps, units)
    return ReportSection(title=title, words=words, sheets=(reached, promised))


def bandwidth_rows(maps: Sequence[FrequencyMap]) -> Array:
    """Rows of a workspace: the lowest of each map, and ``BANDWIDTHS`` spread over joint space."""
    workspace = maps[0].workspace
    lowest = [one.q[one.lowest.argmin()] for one in maps]
    rows = [np.flatnonzero((workspace.q == q).all(axis=1))[:1] for q in lowest]
    share = workspace.weights / workspace.weights.sum()
    count = min(BANDWIDTHS, int(np.count_nonzero(share)))
    rows.append(np.random.default_rng(0).choice(len(workspace), count, replace=False, p=share))
    return np.unique(np.concatenate(rows))


def _validation(proofs: Mapping[str, Validation], pictures: Sequence[Picture]) -> ReportSection:
    runs = {
        f"{label} {pose}": validation
        for label, proof in proofs.items()
        for pose, validation in proof.by_pose.items()
    }
    return ReportSection(
        title="Validation by nonlinear simulation",
        words=(f"{verdict(list(proofs.values()))}.",),
        pictures=tuple(pictures),
        sheets=(validation_sheet(runs),),
    )


def _assumptions(design: Design) -> tuple[str, ...]:
    """Assumptions behind the frequencies, then behind the bound."""
    usual = assumptions(design.today, design.workspace)
    if design.certificate is None or design.bound is None:
        return usual
    return (*usual, f"The bound takes for granted: {', '.join(design.certificate.assumptions)}.")


def _provenance(design: Design, origin: Origin) -> Sheet:
    machines = {"today": design.today, "new": design.written_by(origin.command)}
    seed = f"{origin.options.get('seed', 0)}, of the search's starts"
    requirements = stated_requirements(design.problem)
    return origin.sheet(machines, requirements=requirements, seeds=seed)
