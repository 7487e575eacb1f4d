"""Commands of measurements: ``armdesign identify`` and ``armdesign calibrate``."""

from __future__ import annotations

from armdesign import output
from armdesign.errors import ArmDesignError
from armdesign.option_values import listed, spans, stated_priors
from armdesign.options import (
    BandOption,
    ExcitationOption,
    FitOption,
    MachineOption,
    MeasuredArgument,
    ModesOption,
    PriorOption,
    RecordingArgument,
    SignalOption,
    WindowsOption,
)
from armdesign.runs import OfMachine, OfMachines, command


@command
def identify(
    run: OfMachines,
    recording: RecordingArgument,
    windows: WindowsOption = "",
    signal: SignalOption = "",
    modes: ModesOption = 1,
    excitation: ExcitationOption = "",
    band: BandOption = "",
    machine: MachineOption = "",
) -> None:
    """Find frequency and damping in a recording.

    Prints both with deviations for every window, how they depend on the swing, and whether the
    chambers swing as trapped oil must. Writes identified.csv (which calibrate reads), swings.csv,
    pressures.csv and identified.png.
    """
    from armdesign.report.recordings import identified_sheets
    from armdesign.simulation.identify import identify as found_in

    given, bands = spans(windows, "--windows"), spans(band, "--band")
    if len(bands) > 1:
        raise ArmDesignError("--band", f'"{band}" is more than one band', "give one, as 0.5:4")
    if run.set and not machine:
        raise ArmDesignError("--set", "changes a machine", "give --machine, too")
    with run.progress("fitting"):
        model = run.load(machine) if machine else None
        out = run.folder(recording)
        answer = found_in(
            recording,
            given,
            signal=signal,
            modes=modes,
            excitation=excitation,
            band=bands[0] if bands else None,
            machine=model,
        )
    with run.writing(out) as folder:
        output.write_identified(answer, folder)
    tables = {"identified": answer.frame, "swings": answer.swings}
    run.show(identified_sheets(answer), tables=tables)


@command
def calibrate(
    run: OfMachine, measured: MeasuredArgument, fit: FitOption = "", prior: PriorOption = ""
) -> None:
    """Fit numbers of a machine file to measured frequencies.

    Prints values with deviations, the error at every pose when it is left out, and what the
    measurements cannot tell apart. Writes <name>_calibrated.toml with its URDF, calibration.csv,
    calibration_values.csv and calibration.png.
    """
    from armdesign.calibration.calibrate import calibrate as found_from
    from armdesign.report.calibrations import calibration_sheets

    paths, priors = listed(fit), stated_priors(prior)
    if not paths:
        raise ArmDesignError("--fit", "names nothing", "give key paths, separated by commas")
    with run.progress("fitting"):
        model, out = run.open()
        answer = found_from(model, measured, paths, priors)
    with run.writing(out) as folder:
        output.write_calibration(answer, folder)
    values = answer.values.reset_index()
    tables = {"calibration_values": values, "calibration": answer.frame}
    run.show(calibration_sheets(answer), tables=tables)
