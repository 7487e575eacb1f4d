"""Where in its workspace does the 20 t excavator swing slowest, and which cylinder is to blame?

At 0.910 Hz, boom up and the full bucket curled high above the cab; the boom cylinders limit 84 % of all poses.
"""

from __future__ import annotations

from pathlib import Path

import armdesign as ad

MACHINE = "excavator_20t"
OUT = Path("out") / "01_baseline_map"


def run(fast: bool = False) -> ad.FrequencyMap:
    """The frequency map of today's machine; ``fast`` takes a coarse grid."""
    machine = ad.load(MACHINE)
    return ad.frequency_map(machine, ad.Workspace.grid(machine, points=9 if fast else None))


def main() -> None:
    """Print the answer, save map and figure."""
    from armdesign import plots

    frequencies = run()
    worst = frequencies.worst
    joints = ", ".join(f"{name} {value:.3f} rad" for name, value in zip(worst.joints, worst.q, strict=True))
    print(f"worst {worst.frequency:.3f} Hz at {joints}, payload {worst.payload}, {worst.cylinder} cylinder")
    for cylinder in frequencies.machine.cylinders:
        share = (frequencies.limiting == cylinder.name).mean()
        print(f"{cylinder.name:>8} limits {100 * share:5.1f} % of the poses")
    OUT.mkdir(parents=True, exist_ok=True)
    frequencies.frame.to_csv(OUT / "map.csv", index=False)
    fig, axes = plots.figure(2)
    frequencies.plot(axes[0])
    frequencies.plot(axes[1], plane="reach")
    plots.save(fig, OUT / "map.png")


if __name__ == "__main__":
    main()
