"""How wrong is a machine file made from data sheets, and what does one measurement repair?

The loader crane's rings twice as fast as the recorded crane: +106 to +113 % at six moving poses.
One fitted number, compliance in series, leaves 1.4 %, left-out poses 1.7 %; two leave 1.4 %.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

import armdesign as ad

MACHINE = "loader_crane"
MEASURED = ad.load(MACHINE).source.parent / "measured.csv"
MOVING = 6  # windows; in the seventh the piston is stuck
COMPLIANCE, MODULUS = "cylinder.lift.compliance_m_per_N", "fluid.bulk_modulus_MPa"
AIR = "fluid.entrained_air_percent"
DATA_SHEET = {COMPLIANCE: 0.0, AIR: 0.0, MODULUS: 1200.0}  # what the sources say, see SOURCE.md
FITS = {"one number": [COMPLIANCE], "two numbers": [COMPLIANCE, MODULUS]}
ALL = [COMPLIANCE, MODULUS, AIR]
OUT = Path("out") / "08_calibration"


def run(fast: bool = False) -> tuple[pd.DataFrame, dict[str, ad.Calibration]]:
    """Errors at every measured pose [%], and the calibrations; ``fast`` changes nothing."""
    sheet = ad.load(MACHINE).replace(DATA_SHEET)
    calibrations = {case: ad.calibrate(sheet, MEASURED, fit) for case, fit in FITS.items()}
    calibrations["three numbers"] = ad.calibrate(sheet.replace({AIR: 0.4}), MEASURED, ALL)
    poses = calibrations["one number"].frame
    table = pd.DataFrame({"measured_hz": poses["measured_hz"]})
    for case, machine in (("data sheet", sheet), ("shipped", ad.load(MACHINE))):
        at_rest = machine.with_payload("full").at(poses[list(machine.joints)].to_numpy())
        frequencies = ad.natural_modes(at_rest).frequencies[:, 0]
        table[f"{case}, valves shut"] = 100 * (frequencies / table["measured_hz"] - 1)
    for case, calibration in calibrations.items():
        table[case] = 100 * calibration.frame["calibrated_error"]
        table[f"{case}, left out"] = 100 * calibration.frame["left_out_error"]
    return table, calibrations


def main() -> None:
    """Print errors, values and findings; save the table and the picture of the one number."""
    from armdesign import plots

    table, calibrations = run()
    print(table.to_string(float_format="{:.2f}".format))
    for case, calibration in calibrations.items():
        print(f"\n{case}\n{calibration.values.to_string()}")
        print("\n".join(f"- {line}" for line in calibration.findings))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "errors.csv", index=False)
    plots.save(plots.calibration_figure(calibrations["one number"]), OUT / "one_number.png")


if __name__ == "__main__":
    main()
