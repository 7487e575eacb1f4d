"""Does the calibrated crane, simulated, ring as the recorded one while its lift cylinder moves?

Yes: frequency within 2 %, damping ratio within a factor of 1.3 and mean cap pressure within 1 % in
all six windows. After the stop no: the simulated piston sticks, the real one's structure rings on.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

import armdesign as ad

CRANE = ad.load("loader_crane")
FOLDER = CRANE.source.parent
# The real valve's flow does not depend on the load: 1000 bar behind a small meter-in edge.
# Its meter-out edge is wide: the rod side stands at 0.7 to 4 bar.
EDGES = {"supply_to_cap": 0.1, "annulus_to_return": 10.0}
VALVE = {f"cylinder.lift.valve.edges.{name}": share for name, share in EDGES.items()}
START = [0.00315, -0.74318, 0.03]  # [rad, rad, m] lift cylinder 942 mm, tilt cylinder 1281 mm long
COMMAND = ad.Table(times=(1.5, 1.85, 20.3, 20.8), values=(0.0, 0.128, 0.128, 0.0))  # 14 mm/s
LIFT = partial(ad.simulate, q=START, command={"lift": COMMAND}, duration=27.0, supply_pressure=1e8)
COMPARED = ["frequency_hz", "damping_ratio", "lift_cap_bar"]
OUT = Path("out") / "09_recorded_manoeuvre"


def run(fast: bool = False) -> pd.DataFrame:
    """Simulated values in every window, and over measured. ``fast`` changes nothing."""
    measured = pd.read_csv(FOLDER / "measured.csv", comment="#")[:6]  # moving
    windows = measured[["begin_s", "end_s"]].to_numpy().tolist()
    sweep = ad.sweep(CRANE, [VALVE], rings, payloads=["full"], options={"windows": windows})
    table = pd.DataFrame(sweep.answers.to_numpy().reshape(-1, 3), columns=COMPARED)
    return table.join((table / measured[COMPARED]).add_suffix(" over measured"))


def rings(crane: ad.Machine, _: ad.Workspace, windows: list[list[float]]) -> dict[str, float]:
    """The same values, one after the other."""
    simulated = LIFT(crane)
    values = np.ravel([ring(simulated, *window) for window in windows])
    return {f"{COMPARED[k % 3]}.{k // 3}": value for k, value in enumerate(values)}


def ring(simulated: ad.Simulation, begin: float, end: float) -> tuple[float, float, float]:
    """Frequency and damping of the cap pressure's ring over a parabola, and mean pressure."""
    inside = (simulated.time >= begin) & (simulated.time <= end)
    time, pressure = simulated.time[inside] - begin, simulated.pressures[inside, 0, 0] / 1e5

    def left(shape: np.ndarray) -> np.ndarray:
        omega, zeta = 2 * np.pi * shape[0], shape[1]
        decay = np.exp(omega * (1j * np.sqrt(1 - zeta**2) - zeta) * time)
        columns = np.column_stack([decay.real, decay.imag, time**0, time, time**2])
        return pressure - columns @ np.linalg.lstsq(columns, pressure, rcond=None)[0]

    return *least_squares(left, [2.1, 0.02], x_scale=[0.1, 0.01]).x, pressure.mean()


def main() -> None:
    """Print the table; save it, and measured and simulated cap pressure on one axis."""
    from armdesign import plots

    table, simulated = run(), LIFT(CRANE.with_payload("full").replace(VALVE))
    print(table.to_string(float_format="{:.3f}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "windows.csv", index=False)
    recorded = pd.read_csv(FOLDER / "recording.csv", comment="#")
    fig, (ax,) = plots.figure(1, 9.0, 4.6)
    ax.plot(recorded["time_s"], recorded["lift_cap_bar"], plots.INK, label="measured")
    ax.plot(simulated.time, simulated.pressures[:, 0, 0] / 1e5, plots.MARK, label="simulated")
    ax.set(xlabel="time [s]", ylabel="pressure on the lift cylinder's cap side [bar]")
    ax.legend(frameon=False)
    plots.save(fig, OUT / "pressure.png")


if __name__ == "__main__":
    main()
