"""Does the calibrated crane, simulated, ring as the recorded one while its lift cylinder moves?

Yes: frequency within 2 %, damping ratio within a factor of 1.5 and mean cap pressure within 2 % in
all six windows. After the stop no: the simulated piston sticks, the real one's structure rings on.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

import armdesign as ad

FOLDER = ad.load("loader_crane").source.parent
# The real valve's flow does not depend on the load: simulated by a high pressure behind a small
# meter-in edge. Its meter-out edge is wide: the rod side stands at 0.7 to 4 bar.
PRESSURE = 1000e5  # [Pa]
EDGES = {"supply_to_cap": 0.1, "annulus_to_return": 10.0}
LENGTHS = (0.942, 1.281)  # [m] of lift and tilt cylinder at the start
# Spool: 14 mm/s; it opens within 0.35 s and shuts within 0.5 s.
COMMAND = ad.Table(times=(1.5, 1.85, 20.3, 20.8), values=(0.0, 0.128, 0.128, 0.0))
MOVING = 6  # windows
OUT = Path("out") / "09_recorded_manoeuvre"


def run(fast: bool = False) -> tuple[pd.DataFrame, ad.Simulation]:
    """Simulated over measured in every window, and the run; ``fast``: the first two windows."""
    measured = pd.read_csv(FOLDER / "measured.csv", comment="#")[: 2 if fast else MOVING]
    edges = {f"cylinder.lift.valve.edges.{name}": share for name, share in EDGES.items()}
    machine = ad.load("loader_crane").replace(edges)
    start = [*(joint_at(machine, i, length) for i, length in enumerate(LENGTHS)), 0.03]
    duration = float(measured["end_s"].max()) if fast else 27.0
    simulated = ad.simulate(
        machine,
        start,
        {"lift": COMMAND},
        duration=duration,
        payload="full",
        rate=100.0,
        supply_pressure=PRESSURE,
    )
    rows = [window(simulated, row["begin_s"], row["end_s"]) for _, row in measured.iterrows()]
    table = pd.DataFrame(rows, index=measured.index)
    for name in ("frequency_hz", "damping_ratio", "lift_cap_bar"):
        table[f"{name} over measured"] = table[name] / measured[name]
    return table, simulated


def joint_at(machine: ad.Machine, i: int, length: float) -> float:
    """Position of joint i at which its own cylinder has a length [m]."""
    q = np.tile(machine.ranges.mean(axis=1), (4001, 1))
    q[:, i] = np.linspace(*machine.ranges[i], len(q))
    lengths = machine.at(q).lengths[:, i]
    order = np.argsort(lengths)
    return float(np.interp(length, lengths[order], q[order, i]))


def window(simulated: ad.Simulation, begin: float, end: float) -> dict[str, float]:
    """Mean cap pressure, and a damped sinusoid over a parabola fitted to it."""
    inside = (simulated.time >= begin) & (simulated.time <= end)
    time, pressure = simulated.time[inside] - begin, simulated.pressures[inside, 0, 0] / 1e5

    def left(shape: np.ndarray) -> np.ndarray:
        frequency, damping = shape
        ring = np.exp(2 * np.pi * frequency * (1j * np.sqrt(1 - damping**2) - damping) * time)
        columns = np.column_stack([ring.real, ring.imag, time**0, time, time**2])
        return pressure - columns @ np.linalg.lstsq(columns, pressure, rcond=None)[0]

    frequency, damping = least_squares(left, [2.1, 0.02], x_scale=[0.1, 0.01]).x
    return {
        "begin_s": begin,
        "frequency_hz": float(frequency),
        "damping_ratio": float(damping),
        "lift_cap_bar": float(pressure.mean()),
    }


def main() -> None:
    """Print the table; save it, and measured and simulated cap pressure on one axis."""
    from armdesign import plots

    table, simulated = run()
    print(table.to_string(float_format="{:.3f}".format))
    OUT.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUT / "windows.csv", index=False)
    recording = pd.read_csv(FOLDER / "recording.csv", comment="#")
    fig, (ax,) = plots.figure(1, 9.0, 4.6)
    ax.plot(
        recording["time_s"], recording["lift_cap_bar"], color=plots.INK, lw=1, label="measured"
    )
    pressure = simulated.pressures[:, 0, 0] / 1e5
    ax.plot(simulated.time, pressure, color=plots.MARK, lw=1, label="simulated")
    ax.set(xlabel="time [s]", ylabel="pressure on the lift cylinder's cap side [bar]")
    ax.legend(frameon=False)
    plots.save(fig, OUT / "pressure.png")


if __name__ == "__main__":
    main()
