"""Reports of commands: report.html and report.json of a folder, with the pictures on the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from armdesign.output import write_bandwidths, write_design, write_validations

if TYPE_CHECKING:
    from armdesign.arrays import Array
    from armdesign.control.bandwidth_map import BandwidthMap
    from armdesign.design.design import Design
    from armdesign.frequency.maps import FrequencyMap
    from armdesign.machine.machine import Machine
    from armdesign.plots.charts import Chart
    from armdesign.report.contents import Picture, Report
    from armdesign.report.provenance import Origin
    from armdesign.report.sheet import Sheet
    from armdesign.simulation.validation import Validation
    from armdesign.units import Units


def write_page(report: Report, folder: Path, pictures: Path | None = None) -> None:
    """Write a report as page and as data, from which the page can be written again.

    ``pictures``: where they are; None: in the folder.
    """
    from armdesign.report.contents import FILE, PAGE
    from armdesign.report.page import page

    (folder / FILE).write_text(report.text(), encoding="utf-8")
    (folder / PAGE).write_text(page(report, pictures or folder), encoding="utf-8")


def write_map_report(
    frequencies: FrequencyMap, sheets: Sequence[Sheet], origin: Origin, folder: Path, units: Units
) -> None:
    """Write the report of a map with the pictures that are in the folder."""
    from armdesign.report.contents import Picture
    from armdesign.report.map_reports import map_report

    captions = {
        "map_joints.png": "Lowest natural frequency over joints",
        "map_reach.png": "Lowest natural frequency by place of the tool",
        "map_holding.png": "Largest static pressure over the supply's",
        "lift_chart.png": "Lift chart (ISO 10567)",
        "moment_arms.png": "Moment arms and torques over the joint ranges",
    }
    pictures = [
        Picture(caption=caption, file=file)
        for file, caption in captions.items()
        if (folder / file).exists()
    ]
    provenance = origin.sheet({"": frequencies.machine})
    write_page(map_report(frequencies, sheets, pictures, provenance, units), folder)


def write_plain_report(
    title: str,
    items: Sequence[Sheet | str],
    pictures: Sequence[Picture],
    charts: Mapping[str, Chart],
    drawn: tuple[Machine, Array | None],
    provenance: Sheet,
    folder: Path,
) -> None:
    """Write the report of a command that tells tables, charts and pictures.

    Its lead is the first sentence among the items. Charts are by the files of their pictures,
    which are written here. A machine is drawn at a pose; None: with its joints in the middle.
    """
    from armdesign import plots
    from armdesign.report.contents import Picture, ReportSection
    from armdesign.report.map_reports import plain_report

    lead = next((item for item in items if isinstance(item, str)), "")
    plots.save(plots.machine_drawing(*drawn).figure, folder / "machine.png")
    for file, chart in charts.items():
        plots.save(plots.chart_figure(chart), folder / file)
    machine = Picture(caption="The machine to scale, with its pins", file="machine.png")
    sections = (
        ReportSection(
            title="At a glance",
            charts=tuple(charts.values()),
            pictures=tuple(Picture(caption=one.title, file=file) for file, one in charts.items()),
        ),
        ReportSection(
            title="Results",
            words=tuple(item for item in items if isinstance(item, str) and item is not lead),
            sheets=tuple(item for item in items if not isinstance(item, str)),
            pictures=tuple(pictures),
        ),
        ReportSection(title="The machine", pictures=(machine,)),
        ReportSection(title="Provenance", sheets=(provenance,)),
    )
    write_page(plain_report(title, lead, sections), folder)


def write_control_report(
    maps: Mapping[str, BandwidthMap],
    sheets: Sequence[Sheet],
    origin: Origin,
    folder: Path,
    units: Units,
) -> None:
    """Write bandwidths of machines by label, with their report."""
    from armdesign.report.bandwidths import bandwidth_report
    from armdesign.report.contents import Picture

    pictures = []
    for label, bandwidths in maps.items():
        suffix = f"_{label}" if label else ""
        write_bandwidths(bandwidths, folder, suffix)
        caption = f"Bandwidth of the narrowest loop {label}".strip()
        pictures.append(Picture(caption=caption, file=f"bandwidth{suffix}.png"))
    provenance = origin.sheet({label: one.machine for label, one in maps.items()})
    write_page(bandwidth_report(maps, sheets, pictures, provenance, units), folder)


def write_report(
    design: Design, proofs: dict[str, Validation], origin: Origin, folder: Path, units: Units
) -> None:
    """Everything that ``armdesign design`` leaves behind, report.html among it.

    ``proofs`` are nonlinear runs of today's and the new machine.
    """
    from armdesign import plots
    from armdesign.report.contents import Picture
    from armdesign.report.design_report import design_report

    written = write_design(design, folder)
    write_validations(proofs, folder, "version")
    at_worst = {label: proof.by_pose["worst"] for label, proof in proofs.items()}
    responses = plots.frequency_responses(at_worst)
    caption = "Nonlinear simulation: a small slow sweep at the worst pose of each machine"
    written.append((caption, plots.save(responses, folder / "frequency_responses.png")))
    pictures = [Picture(caption=words, file=path.name) for words, path in written]
    write_page(design_report(design, proofs, pictures, origin, units), folder)
