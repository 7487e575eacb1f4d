"""The source paper's 40 configurations, simulated, identified and compared with its formulas: ``reproduce``.

M. Pencelli et al., "On the Estimation of Resonance Frequencies of Hydraulically Actuated Systems",
ISARC 2019, section 4: eight load masses m2 times five link lengths l2 about θ0 = γ = π/2, an
asymmetric cylinder and a 4/3 valve at constant supply pressure, a sine sweep of the valve, the
highest line in the spectrum of the cylinder's speed.

It gives no number of any of these. They are those of the machine ``paper_1dof`` and the constants
below, so its curves are reproduced in kind, not in number; ``scan`` asks which dimensions would
give its one printed number.

Every configuration is measured twice. The paper's way: one open-loop sweep for all, too large for
some, and the highest line. And as ``validate`` does it: a small sweep with the mean position held,
to whose response ω_n and ζ are fitted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.machine.loading import load
from armdesign.machine.machine import Machine
from armdesign.paper import formulas
from armdesign.simulation.excitation import Sweep
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.identification.modal_fit import spectral_peak
from armdesign.simulation.simulate import Case, Simulation, simulate_all
from armdesign.units import GRAVITY, MPa, litre, mm

if TYPE_CHECKING:
    import pandas as pd

MACHINE = "paper_1dof"
MASSES = (50.0, 100.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0)  # [kg]; the paper: eight
LENGTHS = (0.5, 0.75, 1.0, 1.25, 1.5)  # [m]; the paper: five
SWEEP = Sweep(
    amplitude=0.01, start=1.0, stop=45.0, duration=2.5, fade=0.02
)  # of the spool; the paper: a sine sweep
RATE = 200.0  # records per second
COARSE, FINE = (
    1e-5,
    1e-6,
)  # tolerances of the integration: for the highest of lines 0.4 Hz apart, and for fits
# [rad/s], root mean square error of (11) in the paper; that of (42) is missing in our copy
PUBLISHED = 23.49

FORMULAS = {
    "static_11": "rigid load, static mass: (11), bore area",
    "static_12_as_printed": "rigid load, static mass: (12) as printed",
    "static_12": "rigid load, static mass: (12) put right",
    "reflected_12": "rigid load, reflected mass J/r²: (12) put right",
    "joint_42_as_printed": "joint-coupled: (42) as printed, bore area",
    "joint_42_mean_area": "joint-coupled: (42) as printed, mean area",
    "joint_exact": "joint-coupled, exact, both areas",
}
WAYS = {"swept": "the paper's way", "identified": "small amplitude, fitted"}

# What ``scan`` combines: sizes of ISO 3320, pins in the proportions of the machine, supply
# pressure as there.
BORES_AND_RODS = ((40, 22), (50, 28), (63, 36), (80, 45), (100, 56), (125, 70))  # [mm]
STROKES = (200, 400, 600, 800)  # [mm]
DEAD_VOLUMES = (0.1, 0.3, 1.0)  # of each chamber [l]
BULK_MODULI = (800, 1200)  # [MPa]
LOADS = (
    (25, 200),
    (50, 400),
    (100, 450),
    (100, 800),
    (200, 1600),
    (250, 600),
    (500, 1200),
)  # first and last [kg]
REACHES = ((0.5, 1.5), (0.25, 0.75), (0.5, 1.0), (1.0, 2.0), (1.0, 3.0))  # first and last [m]
HELD = 0.87  # largest share of supply pressure × area for a load that counts as held


# ------------------------------------------------------------------------------------- closed form


@dataclass(frozen=True, eq=False, kw_only=True)
class Mechanism:
    """The paper's mechanism at θ0 = π/2 with an asymmetric cylinder.

    SI, numbers or arrays that broadcast together.

    Attributes:
        load_mass: m2.
        link_length: l2.
        link_pin_distance: a1.
        base_pin_distance: d1.
        bore_area: A1.
        annulus_area: A2.
        cap_volume: V1, dead volume included.
        annulus_volume: V2, likewise.
        stroke: of the piston.
        bulk_modulus: β.
    """

    load_mass: Any
    link_length: Any
    link_pin_distance: Any
    base_pin_distance: Any
    bore_area: Any
    annulus_area: Any
    cap_volume: Any
    annulus_volume: Any
    stroke: Any
    bulk_modulus: Any

    @classmethod
    def of(cls, machine: Machine, load_mass: Any, link_length: Any) -> Mechanism:
        """That of ``paper_1dof`` or a variant of it, under loads that need not be the machine's."""
        cylinder, linkage = machine.cylinders[0], machine.linkages[0]
        assert (
            linkage.rod_end is not None
        )  # for the type checker: it sits on the link, not on a knee
        base, rod_end = np.array(linkage.base.at), np.array(linkage.rod_end.at)
        cap, annulus = cylinder.volumes(
            machine.at(np.zeros(1)).lengths[0, 0] - cylinder.closed_length
        )
        return cls(
            load_mass=load_mass,
            link_length=link_length,
            link_pin_distance=float(np.linalg.norm(rod_end)),
            base_pin_distance=float(np.linalg.norm(base)),
            bore_area=cylinder.bore_area,
            annulus_area=cylinder.annulus_area,
            cap_volume=cap,
            annulus_volume=annulus,
            stroke=cylinder.stroke,
            bulk_modulus=machine.fluid.bulk_modulus,
        )

    @property
    def pins(self) -> dict[str, Any]:
        """a1 and d1, as ``formulas`` take them."""
        return {
            "link_pin_distance": self.link_pin_distance,
            "base_pin_distance": self.base_pin_distance,
        }

    @property
    def loaded(self) -> dict[str, Any]:
        """Load and pins, as ``formulas`` take them."""
        return {"load_mass": self.load_mass, "link_length": self.link_length, **self.pins}

    @property
    def chambers(self) -> dict[str, Any]:
        """Areas, volumes and oil, as ``formulas`` take them."""
        return {
            "bore_area": self.bore_area,
            "annulus_area": self.annulus_area,
            "cap_volume": self.cap_volume,
            "annulus_volume": self.annulus_volume,
            "bulk_modulus": self.bulk_modulus,
        }

    @property
    def stiffness(self) -> Any:
        """k_h of both chambers [N/m]: β (A1²/V1 + A2²/V2)."""
        return self.bulk_modulus * (
            self.bore_area**2 / self.cap_volume + self.annulus_area**2 / self.annulus_volume
        )

    @property
    def symmetric(self) -> dict[str, Any]:
        """The paper's A and V0 for an asymmetric cylinder, which it does not define: here those of the bore side."""
        return {
            "area": self.bore_area,
            "chamber_volume": self.cap_volume,
            "bulk_modulus": self.bulk_modulus,
        }

    @property
    def symmetric_mean(self) -> dict[str, Any]:
        """The same from the means of both sides."""
        area, volume = (
            (self.bore_area + self.annulus_area) / 2,
            (self.cap_volume + self.annulus_volume) / 2,
        )
        return {"area": area, "chamber_volume": volume, "bulk_modulus": self.bulk_modulus}

    @property
    def static_mass(self) -> Any:
        """The mass that the paper puts into (11) [kg]: the static force at θ0 as a weight."""
        return formulas.equivalent_mass(static_force=formulas.static_force(**self.loaded))

    @property
    def frequencies(self) -> dict[str, Any]:
        """Natural frequency [Hz] by each of ``FORMULAS``."""
        inertia = formulas.joint_inertia(
            load_mass=self.load_mass,
            link_pin_distance=self.link_pin_distance,
            link_length=self.link_length,
        )
        reflected = formulas.reflected_mass(
            joint_inertia=inertia, moment_arm=formulas.moment_arm(**self.pins)
        )
        static = self.static_mass
        return {
            "static_11": formulas.rigid_load(mass=static, **self.symmetric),
            "static_12_as_printed": formulas.rigid_load_asymmetric_as_printed(
                mass=static, **self.chambers
            ),
            "static_12": formulas.rigid_load_asymmetric(mass=static, **self.chambers),
            "reflected_12": formulas.rigid_load_asymmetric(mass=reflected, **self.chambers),
            "joint_42_as_printed": formulas.joint_coupled_as_printed(
                **self.loaded, **self.symmetric
            ),
            "joint_42_mean_area": formulas.joint_coupled_as_printed(
                **self.loaded, **self.symmetric_mean
            ),
            "joint_exact": formulas.joint_coupled(**self.loaded, stiffness=self.stiffness),
        }

    def with_gravity(self, stiffness: Any, inertia: Any = 0.0) -> Any:
        """Frequency [Hz] if gravity took another ``stiffness`` [N m/rad], with an ``inertia`` [kg m²] added."""
        arm = formulas.moment_arm(**self.pins)
        total = self.load_mass * (self.link_pin_distance**2 + self.link_length**2) + inertia
        return np.sqrt(np.maximum(self.stiffness * arm**2 - stiffness, 0.0) / total) / (
            2 * math.pi
        )


def grid(
    machine: Machine, masses: Sequence[float] = MASSES, lengths: Sequence[float] = LENGTHS
) -> Mechanism:
    """The configurations in closed form: every array (masses × lengths,), the length running fastest.

    Raises:
        ArmDesignError: no mass or no length, or one that is not positive.
    """
    for name, values in (("masses", masses), ("lengths", lengths)):
        wrong = [value for value in values if not (math.isfinite(value) and value > 0)]
        if wrong or len(values) == 0:
            problem = f"{wrong[0]:g} is not allowed" if wrong else "none given"
            raise ArmDesignError(f"paper: {name}", problem, "give positive numbers in kg and m")
    pairs = np.array(list(product(masses, lengths)))
    return Mechanism.of(machine, pairs[:, 0], pairs[:, 1])


def rms_error(computed: Any, reference: Any, axis: int | tuple[int, ...] = -1) -> Any:
    """Root mean square [rad/s] of the difference of frequencies in Hz, the paper's measure."""
    return 2 * math.pi * np.sqrt(np.mean((np.asarray(computed) - reference) ** 2, axis=axis))


def error_of(computed: Mapping[str, Array], reference: Array) -> dict[str, float]:
    """Root mean square error [rad/s] of each formula's frequencies (n,) [Hz] against others (n,) [Hz]."""
    return {name: float(rms_error(values, reference)) for name, values in computed.items()}


# ------------------------------------------------------------------------------------ measurements


@dataclass(frozen=True)
class Measurement:
    """What was found in one configuration.

    Attributes:
        swept: highest line of the cylinder's speed in the open-loop sweep [Hz].
        drift: of the piston from first to last in it [m].
        least_pressure: in either chamber in it [Pa]; below 0 the oil cavitates.
        identified: natural frequency fitted at small amplitude [Hz].
        damping: ratio, fitted likewise.
        amplitude: mean opening of the valve in the small sweep.
    """

    swept: float
    drift: float
    least_pressure: float
    identified: float
    damping: float
    amplitude: float


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The paper's table, figures 3 to 6 and errors.

    Arrays (n,) over the configurations are read-only.

    Attributes:
        machine: whose load and link length were varied.
        mechanism: the configurations in closed form.
        sweep: of the spool, the same for all.
        measurements: one per configuration.
    """

    machine: Machine
    mechanism: Mechanism
    sweep: Sweep
    measurements: tuple[Measurement, ...]

    @cached_property
    def computed(self) -> dict[str, Array]:
        """Frequencies (n,) [Hz] by each of ``FORMULAS``."""
        return {name: _fixed(values) for name, values in self.mechanism.frequencies.items()}

    @property
    def swept(self) -> Array:
        """Identified the paper's way (n,) [Hz]."""
        return _fixed([found.swept for found in self.measurements])

    @property
    def identified(self) -> Array:
        """Fitted at small amplitude (n,) [Hz]."""
        return _fixed([found.identified for found in self.measurements])

    @property
    def frame(self) -> pd.DataFrame:
        """One row per configuration, as in ``paper.csv``."""
        import pandas as pd

        columns: dict[str, Any] = {
            "load_kg": self.mechanism.load_mass,
            "link_length_m": self.mechanism.link_length,
            "swept_hz": self.swept,
            "identified_hz": self.identified,
            "identified_damping": [found.damping for found in self.measurements],
            "amplitude": [found.amplitude for found in self.measurements],
            "drift_m": [found.drift for found in self.measurements],
            "least_pressure_pa": [found.least_pressure for found in self.measurements],
        }
        return pd.DataFrame(
            columns | {f"{name}_hz": values for name, values in self.computed.items()}
        )

    @property
    def errors(self) -> pd.DataFrame:
        """Root mean square error [rad/s] of each formula (rows) against each way of measuring (columns)."""
        import pandas as pd

        ways = {"swept": self.swept, "identified": self.identified}
        columns = {way: error_of(self.computed, found) for way, found in ways.items()}
        return pd.DataFrame(columns).rename_axis("formula")

    @property
    def cavitated(self) -> int:
        """In how many configurations the open-loop sweep left a chamber without pressure."""
        return sum(found.least_pressure < 0 for found in self.measurements)

    def plot(self, formula: str) -> Any:
        """The paper's pair of figures for one of ``FORMULAS``, against mass and length.

        Returns the figure.
        """
        from armdesign.paper.figures import paper_pair

        return paper_pair(self, formula)


def reproduce(
    machine: Machine | None = None,
    masses: Sequence[float] = MASSES,
    lengths: Sequence[float] = LENGTHS,
    sweep: Sweep = SWEEP,
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


def _measurements(machines: Sequence[Machine], sweep: Sweep) -> tuple[Measurement, ...]:
    """All runs, side by side, from the rest of ``Experiment``: about a preload, as the authors' valve leaves it."""
    pose, small = np.zeros(1), [Experiment.of(machine, np.zeros(1), 0, 0) for machine in machines]
    amplitudes = [experiment.default_amplitude() for experiment in small]
    cases = [
        Case(
            machine=m,
            q=pose,
            command={m.cylinders[0].name: sweep},
            duration=sweep.duration,
            rate=RATE,
            preloaded=one.preloaded,
        )
        for m, one in zip(machines, small, strict=True)
    ]
    held = [
        experiment.case(experiment.sweep(amplitude))
        for experiment, amplitude in zip(small, amplitudes, strict=True)
    ]
    pairs = zip(
        small,
        amplitudes,
        simulate_all(cases, tolerance=COARSE),
        simulate_all(held, tolerance=FINE),
        strict=True,
    )
    return tuple(_measured(sweep, *row) for row in pairs)


def _measured(
    sweep: Sweep, small: Experiment, amplitude: float, motion: Simulation, held: Simulation
) -> Measurement:
    part = f"{small.machine.name}: sweep"
    peak = spectral_peak(motion.time, motion.speeds[:, 0], (sweep.start, sweep.stop), part)
    fit = small.fit(held)
    return Measurement(
        swept=peak,
        drift=float(motion.extensions[-1, 0] - motion.extensions[0, 0]),
        least_pressure=float(motion.pressures.min()),
        identified=float(fit.natural_frequencies[0]),
        damping=float(fit.damping_ratios[0]),
        amplitude=amplitude,
    )


def _fixed(values: Any) -> Array:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


# ------------------------------------------------------------------------------------------ errata


@dataclass(frozen=True, eq=False)
class Erratum:
    """A misprint or slip of the paper and what it does to a frequency, all else being right.

    Attributes:
        equation: its number.
        printed: what the paper has.
        right: what it should be.
        wrong_frequency: with it (n,) [Hz]; None: it is in no frequency.
        right_frequency: without it (n,) [Hz].
        remark: what to know about the comparison.
    """

    equation: str
    printed: str
    right: str
    wrong_frequency: Any = None
    right_frequency: Any = None
    remark: str = ""

    @property
    def change(self) -> Array | None:
        """Relative change of the frequency (n,)."""
        return (
            None
            if self.wrong_frequency is None
            else np.asarray(self.wrong_frequency / self.right_frequency - 1)
        )

    @property
    def error(self) -> float:
        """Root mean square of the difference [rad/s]; 0 where it is in no frequency."""
        return (
            0.0
            if self.wrong_frequency is None
            else float(rms_error(self.wrong_frequency, self.right_frequency))
        )


def errata(at: Mechanism) -> list[Erratum]:
    """The paper's errata, THEORY section 5, each by itself, over the configurations of a mechanism."""
    found = at.frequencies
    exact = found["joint_exact"]
    weight, a1, l2 = at.load_mass * GRAVITY, at.link_pin_distance, at.link_length
    pull = weight * a1 * l2 * at.base_pin_distance / (a1**2 + at.base_pin_distance**2)  # F0 ∂r/∂θ
    no_pull, printed = at.with_gravity(weight * a1), at.with_gravity(weight * l2)
    off = replace(
        at,
        cap_volume=at.cap_volume - at.bore_area * at.stroke / 4,
        annulus_volume=at.annulus_volume + at.annulus_area * at.stroke / 4,
    ).frequencies["joint_exact"]
    one_area = formulas.joint_coupled(**at.loaded, **at.symmetric)
    inverse = 1 / (2 * math.pi) / (2 * math.pi * exact)
    literal = at.with_gravity(weight * a1 + pull, inertia=l2)
    flipped = at.with_gravity(weight * a1 - pull)
    return [
        Erratum(
            "(12)", "2β/M", "β/M", found["static_12_as_printed"], found["static_12"], "static mass"
        ),
        Erratum("(13)", "missing", "the cosine formula"),
        Erratum(
            "(16)",
            "lengths l1, l2",
            "inertias I1, I2",
            literal,
            exact,
            "I2 = l2 in number, though (42) has neither",
        ),
        Erratum(
            "(27)",
            "+m2 g l2",
            "−m2 g l2",
            flipped,
            exact,
            "carried into F0 ∂r/∂θ, though not in (42)",
        ),
        Erratum(
            "(33) ∂g/∂θ", "−m2 g l2", "−m2 g a1", printed, no_pull, "F0 ∂r/∂θ left out of both"
        ),
        Erratum("(33) −F0 ∂r/∂θ", "missing", "−m2 g a1 l2 d1/x²", no_pull, exact),
        Erratum(
            "(38), (39), (42)",
            "−m2 g l2",
            "−m2 g a1 (1 + l2 d1/x²)",
            printed,
            exact,
            "both of (33) together",
        ),
        Erratum(
            "(34) volumes",
            "V1 = V2 = V0",
            "V1, V2 by position",
            exact,
            off,
            "piston at a quarter of its stroke",
        ),
        Erratum(
            "(34) areas",
            "one A",
            "A1, A2",
            one_area,
            exact,
            "the bore's; the paper leaves this open",
        ),
        Erratum("(40)", "2 in μ", "1 in μ", remark="the gain doubles"),
        Erratum(
            "(42) root", "√(K/Q)", "√(Q/K)", inverse, exact, "no frequency but the inverse of one"
        ),
    ]


def errata_frame(found: Sequence[Erratum]) -> pd.DataFrame:
    """One row per erratum: least and largest relative change, root mean square [rad/s].

    Empty where in no frequency.
    """
    import pandas as pd

    rows = []
    for item in found:
        change = item.change
        row: dict[str, Any] = {
            "equation": item.equation,
            "printed": item.printed,
            "right": item.right,
        }
        if change is not None:
            row |= {"least": change.min(), "largest": change.max(), "rms_rad_per_s": item.error}
        rows.append(row | {"remark": item.remark})
    return pd.DataFrame(
        rows,
        columns=["equation", "printed", "right", "least", "largest", "rms_rad_per_s", "remark"],
    )


# -------------------------------------------------------------------------------------------- scan


def scan() -> pd.DataFrame:
    """Errors [rad/s] of every formula, against the exact one, for cylinders and grids that the paper might have had.

    Pins keep the proportions of ``paper_1dof`` to the stroke; the piston stands at mid-stroke. One
    row per combination of the constants above: sizes, first and last mass and length, ``held``
    (largest static force over supply pressure × annulus area: the load pulls), lowest and highest
    exact frequency, an error per formula. Rows that no supply holds (``held`` > ``HELD``) are left
    out.
    """
    import pandas as pd

    machine = load(MACHINE)
    choices = product(BORES_AND_RODS, STROKES, DEAD_VOLUMES, BULK_MODULI, LOADS, REACHES)
    names = ["bore_mm", "rod_mm", "stroke_mm", "dead_volume_l", "bulk_modulus_MPa"]
    names += ["mass_from_kg", "mass_to_kg", "length_from_m", "length_to_m"]
    rows = [(*sizes, S, V, beta, *mass, *reach) for sizes, S, V, beta, mass, reach in choices]
    table = pd.DataFrame(rows, columns=names, dtype=float)
    at = _candidates(table, Mechanism.of(machine, 1.0, 1.0))
    found = at.frequencies
    force = at.static_mass * GRAVITY / (machine.supply.pressure * at.annulus_area)
    table["held"] = force.max(axis=(1, 2))
    exact = found["joint_exact"]
    table["lowest_hz"], table["highest_hz"] = exact.min(axis=(1, 2)), exact.max(axis=(1, 2))
    for name in FORMULAS:
        table[name] = rms_error(found[name], exact, axis=(1, 2))
    return table[table["held"] <= HELD].reset_index(drop=True)


def _candidates(table: pd.DataFrame, like: Mechanism) -> Mechanism:
    """The scan's rows as one mechanism of arrays (rows, masses, lengths)."""

    def column(name: str) -> Array:
        return np.asarray(table[name])[:, None, None]

    stroke, dead = column("stroke_mm") * mm, column("dead_volume_l") * litre
    bore, ring = (
        math.pi / 4 * (column("bore_mm") * mm) ** 2,
        math.pi / 4 * (column("rod_mm") * mm) ** 2,
    )
    masses = np.linspace(
        column("mass_from_kg")[:, 0], column("mass_to_kg")[:, 0], len(MASSES), axis=1
    )
    lengths = np.linspace(
        column("length_from_m")[:, 0], column("length_to_m")[:, 0], len(LENGTHS), axis=2
    )
    scale = stroke / like.stroke
    return Mechanism(
        load_mass=masses,
        link_length=lengths,
        link_pin_distance=like.link_pin_distance * scale,
        base_pin_distance=like.base_pin_distance * scale,
        bore_area=bore,
        annulus_area=bore - ring,
        cap_volume=bore * stroke / 2 + dead,
        annulus_volume=(bore - ring) * stroke / 2 + dead,
        stroke=stroke,
        bulk_modulus=column("bulk_modulus_MPa") * MPa,
    )
