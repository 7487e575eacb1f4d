"""Does the calibrated crane, simulated, ring as the recorded one while its lift cylinder moves?

Yes: frequency within 2 %, damping ratio within a factor of 1.3 and mean cap pressure within 1 % in
all six windows. After the stop no: the simulated piston sticks, the real one's structure rings on.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

import armdesign as ad

CRANE = ad.load("loader_crane")
FOLDER = CRANE.source.parent
# The real valve's flow does not depend on the load: a high pressure behind a small meter-in edge.
# Its meter-out edge is wide: the rod side stands at 0.7 to 4 bar.
PRESSURE = 1000e5  # [Pa]
EDGES = {"supply_to_cap": 0.1, "annulus_to_return": 10.0}
START = [0.00315, -0.74318, 0.03]  # [rad, rad, m] lift cylinder 942 mm, tilt cylinder 1281 mm long
# 14 mm/s; the spool opens within 0.35 s and shuts within 0.5 s
COMMAND = ad.Table(times=(1.5, 1.85, 20.3, 20.8), values=(0.0, 0.128, 0.128, 0.0))
COMPARED = ["frequency_hz", "damping_ratio", "lift_cap_bar"]
OUT = Path("out") / "09_recorded_manoeuvre"


def run(fast: bool = False) -> tuple[pd.DataFrame, ad.Simulation]:
    """Simulated values in every window, and over measured; the run. ``fast`` changes nothing."""
    measured = pd.read_csv(FOLDER / "measured.csv", comment="#")[:6]  # moving
    edges = {f"cylinder.lift.valve.edges.{name}": share for name, share in EDGES.items()}
    crane = CRANE.with_payload("full").replace(edges)
    command = {"lift": COMMAND}
    simulated = ad.simulate(crane, START, command, duration=27.0, supply_pressure=PRESSURE)
    windows = zip(measured["begin_s"], measured["end_s"], strict=True)
    table = pd.DataFrame([ring(simulated, *window) for window in windows], columns=COMPARED)
    return table.join((table / measured[COMPARED]).add_suffix(" over measured")), simulated


def ring(simulated: ad.Simulation, begin: float, end: float) -> tuple[float, float, float]:
    """Frequency and damping of the cap pressure's ring over a parabola, and mean pressure."""
    inside = (simulated.time >= begin) & (simulated.time <= end)
    time, pressure = simulated.time[inside] - begin, simulated.pressures[inside, 0, 0] / 1e5

    def left(shape: np.ndarray) -> np.ndarray:
        omega, zeta = 2 * np.pi * shape[0], shape[1]
        decay = np.exp(omega * (1j * np.sqrt(1 - zeta**2) - zeta) * time)
        columns = np.column_stack([decay.real, decay.imag, time**0, time, time**2])
        return pressure - columns @ np.linalg.lstsq(columns, pressure, rcond=None)[0]

    frequency, damping = least_squares(left, [2.1, 0.02], x_scale=[0.1, 0.01]).x
    return float(frequency), float(damping), float(pressure.mean())


def main() -> None:
    """Print the table; save it, and measured and simulated cap pressure on one axis."""
    from armdesign import plots

    table, simulated = run()
    print(table.to_string(float_format="{:.3f}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "windows.csv", index=False)
    recording = pd.read_csv(FOLDER / "recording.csv", comment="#")
    fig, (ax,) = plots.figure(1, 9.0, 4.6)
    ax.plot(recording["time_s"], recording["lift_cap_bar"], color=plots.INK, label="measured")
    style = {"color": plots.MARK, "label": "simulated"}
    ax.plot(simulated.time, simulated.pressures[:, 0, 0] / 1e5, **style)
    ax.set(xlabel="time [s]", ylabel="pressure on the lift cylinder's cap side [bar]")
    ax.legend(frameon=False)
    plots.save(fig, OUT / "pressure.png")


if __name__ == "__main__":
    main()
