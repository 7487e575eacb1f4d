"""The command ``armdesign paper``."""

from __future__ import annotations

from typing import Any

from armdesign import output_reports
from armdesign.output import write_csv
from armdesign.runs import Run, command


@command
def paper(run: Run) -> None:
    """Simulate the source paper's 40 configurations.

    Compares its formulas with frequencies identified in nonlinear runs, the paper's way and at
    small amplitude; lists its errata, and dimensions that would give the error it prints. Writes
    paper.csv, paper_errors.csv, paper_errata.csv, paper_scan.csv, paper_sweep_bias.csv, figures,
    report.html.
    """
    from armdesign import plots
    from armdesign.paper import reproduction
    from armdesign.paper.configurations import FORMULAS
    from armdesign.paper.errata import errata, errata_frame, scan
    from armdesign.paper.sheets import PAIRS, paper_chart, paper_sentence, paper_sheets
    from armdesign.report.contents import Picture
    from armdesign.simulation.identification.sweep_bias import sweep_bias

    out = run.folder()
    run.go_on(out)
    with run.progress("sweeping 40 configurations"):
        reproduced = reproduction.reproduce()
        listed_errata, scanned, bias = errata(reproduced.mechanism), scan(), sweep_bias()
    caption = "Frequencies of the sweeps beside"
    pictures = [Picture(caption=f"{caption} {FORMULAS[of]}", file=f) for f, of in PAIRS.items()]
    sheets: list[Any] = paper_sheets(reproduced, listed_errata, scanned, bias)
    sheets.append(paper_sentence(reproduced))
    charts = {"paper_by_mass.png": paper_chart(reproduced)}
    title = "The source paper's 40 configurations, simulated"
    with run.writing(out) as folder:
        write_csv(reproduced.frame, folder / "paper.csv")
        write_csv(reproduced.errors.reset_index(), folder / "paper_errors.csv")
        write_csv(errata_frame(listed_errata), folder / "paper_errata.csv")
        write_csv(scanned, folder / "paper_scan.csv")
        write_csv(bias, folder / "paper_sweep_bias.csv")
        for file, formula in PAIRS.items():
            plots.save(reproduced.plot(formula), folder / file)
        provenance = run.origin().sheet({"": reproduced.machine})
        drawn = reproduced.machine, None
        output_reports.write_plain_report(
            title, sheets, pictures, charts, drawn, provenance, folder
        )
    errors = reproduced.errors.reset_index()
    run.show(sheets, tables={"paper": reproduced.frame, "paper_errors": errors})
