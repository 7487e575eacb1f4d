"""The paper's 40 configurations, simulated, identified and compared with its formulas.

M. Pencelli et al., "On the Estimation of Resonance Frequencies of Hydraulically Actuated Systems",
ISARC 2019, section 4: eight load masses m2 times five link lengths l2 about θ0 = γ = π/2, an
asymmetric cylinder and a 4/3 valve at constant supply pressure, a sine sweep of the valve, the
highest line in the spectrum of the cylinder's speed. It gives no number of any of these, so its
curves are reproduced in kind (``configurations`` has what stands in).

Every configuration is measured twice. The paper's way: one open-loop sweep for all, too large for
some, and the highest line. And as ``validate`` does it: a small sweep with the mean position held,
to whose response ω_n and ζ are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.journal.finished import Form, finished
from armdesign.machine.loading import load
from armdesign.machine.machine import Machine
from armdesign.paper.configurations import LENGTHS, MACHINE, MASSES, Mechanism, error_of, grid
from armdesign.simulation.excitation import SweptSine
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.identification.modal_fit import spectral_peak
from armdesign.simulation.run import Simulation
from armdesign.simulation.simulate import SimulationCase, simulate_all
from armdesign.units import mm

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Figure

# amplitude: share of the spool's travel; the paper says "a sine sweep"
SWEEP = SweptSine(amplitude=0.01, start=1.0, stop=45.0, duration=2.5, fade=0.02)
RATE = 200.0  # records per second
COARSE = 1e-5  # tolerance of the integration for the highest of lines that are 0.4 Hz apart
FINE = 1e-6  # tolerance for fits
WAYS = {"swept": "the paper's way", "identified": "small amplitude, fitted"}
MEASURED = {  # fields of a measurement, by their columns in ``paper.csv``
    "swept_hz": "swept",
    "identified_hz": "identified",
    "identified_damping": "damping",
    "amplitude": "amplitude",
    "drift_m": "drift",
    "least_pressure_pa": "least_pressure",
}


@dataclass(frozen=True)
class Measurement:
    """Measured frequencies of one configuration."""

    swept: float  # highest line of the cylinder's speed in the open-loop sweep [Hz]
    drift: float  # of the piston from first to last in it [m]
    least_pressure: float  # in either chamber in it [Pa]; below 0 the oil cavitates
    identified: float  # natural frequency fitted at small amplitude [Hz]
    damping: float  # ratio, fitted likewise
    amplitude: float  # mean opening of the valve in the small sweep


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The paper's table, figures 3 to 6 and errors.

    Arrays (n,) over the configurations are read-only.
    """

    machine: Machine  # whose load and link length were varied
    mechanism: Mechanism  # the configurations in closed form
    sweep: SweptSine  # of the spool, the same for all
    measurements: tuple[Measurement, ...]  # one per configuration

    @cached_property
    def computed(self) -> dict[str, Array]:
        """Frequencies (n,) [Hz] by each of ``FORMULAS``."""
        return {name: _fixed(values) for name, values in self.mechanism.frequencies.items()}

    @property
    def swept(self) -> Array:
        """Frequencies identified the paper's way (n,) [Hz]."""
        return _fixed([one.swept for one in self.measurements])

    @property
    def identified(self) -> Array:
        """Frequencies fitted at small amplitude (n,) [Hz]."""
        return _fixed([one.identified for one in self.measurements])

    @property
    def frame(self) -> pd.DataFrame:
        """One row per configuration, as in ``paper.csv``."""
        import pandas as pd

        columns = {
            "load_kg": self.mechanism.load_mass,
            "link_length_m": self.mechanism.link_length,
        }
        for column, name in MEASURED.items():
            columns[column] = [getattr(one, name) for one in self.measurements]
        columns |= {f"{name}_hz": values for name, values in self.computed.items()}
        return pd.DataFrame(columns)

    @property
    def errors(self) -> pd.DataFrame:
        """Root mean square error [rad/s]: rows are formulas, columns ways of measuring."""
        import pandas as pd

        columns = {way: error_of(self.computed, getattr(self, way)) for way in WAYS}
        return pd.DataFrame(columns).rename_axis("formula")

    @property
    def cavitated(self) -> int:
        """Number of configurations in which the oil cavitated in the open-loop sweep."""
        return sum(one.least_pressure < 0 for one in self.measurements)

    def plot(self, formula: str) -> Figure:
        """The paper's pair of figures for one of ``FORMULAS``, against mass and length."""
        from armdesign.paper.sheets import paper_pair

        return paper_pair(self, formula)


def reproduce(
    machine: Machine | None = None,
    masses: Sequence[float] = MASSES,
    lengths: Sequence[float] = LENGTHS,
    sweep: SweptSine = SWEEP,
) -> Reproduction:
    """Measure every configuration both ways.

    Args:
        machine: ``paper_1dof`` or a variant of it; None: as shipped.
        masses: of the load [kg].
        lengths: l2 [m].
        sweep: of the spool, for the paper's way.

    Raises:
        ArmDesignError: no mass or no length, or one that is not positive.
        SimulationError: the supply cannot hold a load, a run gives up, or its response cannot be
            fitted.
    """
    machine = load(MACHINE) if machine is None else machine
    mechanism = grid(machine, masses, lengths)
    cases = [_configured(machine, mass, length) for mass, length in product(masses, lengths)]
    return Reproduction(machine, mechanism, sweep, _measurements(cases, sweep))


def _configured(machine: Machine, mass: float, length: float) -> Machine:
    payload = f"payload.{machine.payload.name}"
    _, y, z = machine.payload.at
    return machine.replace(
        {f"{payload}.mass_kg": mass, f"{payload}.at_mm": [length / mm, y / mm, z / mm]}
    )


def _measurements(machines: Sequence[Machine], sweep: SweptSine) -> tuple[Measurement, ...]:
    """All runs side by side, about the preload that the authors' valve leaves (``Experiment``)."""
    small = [Experiment.of(machine, np.zeros(1), 0, 0) for machine in machines]
    amplitudes = [experiment.default_amplitude() for experiment in small]
    rows: Form[list[tuple[float, ...]]] = Form(
        write=lambda _, rows: {"rows": rows}, read=lambda _, answer: answer["rows"]
    )

    def identity() -> list[Any]:
        return [repr(sweep), [machine.identity for machine in machines]]

    def swept() -> list[tuple[float, ...]]:
        cases = [_open_loop(experiment, sweep) for experiment in small]
        part, runs = f"{machines[0].name}: sweep", simulate_all(cases, tolerance=COARSE)
        return [_swept(sweep, motion, part) for motion in runs]

    def fitted() -> list[tuple[float, ...]]:
        pairs = zip(small, amplitudes, strict=True)
        held = [one.case(one.swept_sine(amplitude)) for one, amplitude in pairs]
        runs = simulate_all(held, tolerance=FINE)
        return [
            _fitted(experiment, motion) for experiment, motion in zip(small, runs, strict=True)
        ]

    one_way = finished("configurations the paper's way", identity, swept, rows)
    other_way = finished("configurations at small amplitude", identity, fitted, rows)
    return tuple(
        Measurement(
            swept=peak,
            drift=drift,
            least_pressure=least,
            identified=frequency,
            damping=damping,
            amplitude=amplitude,
        )
        for (peak, drift, least), (frequency, damping), amplitude in zip(
            one_way, other_way, amplitudes, strict=True
        )
    )


def _open_loop(small: Experiment, sweep: SweptSine) -> SimulationCase:
    """The paper's sweep of an experiment's machine."""
    return SimulationCase(
        machine=small.rest.machine,
        q=np.zeros(1),
        command={small.rest.machine.cylinders[0].name: sweep},
        duration=sweep.duration,
        rate=RATE,
        preloaded=small.rest.preloaded,
    )


def _swept(sweep: SweptSine, motion: Simulation, part: str) -> tuple[float, ...]:
    """Highest line [Hz], drift [m] and least pressure [Pa] of an open-loop sweep."""
    peak = spectral_peak(motion.time, motion.speeds[:, 0], (sweep.start, sweep.stop), part)
    drift = float(motion.extensions[-1, 0] - motion.extensions[0, 0])
    return float(peak), drift, float(motion.pressures.min())


def _fitted(experiment: Experiment, motion: Simulation) -> tuple[float, ...]:
    """Natural frequency [Hz] and damping ratio of a small sweep."""
    fit = experiment.fit(motion)
    return float(fit.natural_frequencies[0]), float(fit.damping_ratios[0])


def _fixed(values: Any) -> Array:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
