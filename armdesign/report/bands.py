"""Sheet of the bands of what is not known exactly: frequencies at their ends, and gains."""

from __future__ import annotations

from collections.abc import Mapping

from armdesign.frequency.bands import EXACT, Bands
from armdesign.frequency.frequency_band import FrequencyBand
from armdesign.machine.machine import Machine
from armdesign.report.sheet import Sheet
from armdesign.units import percent

SAME = 1e-9  # relative, of frequencies
BANDS_TITLE = "Lowest frequency of the poses within the bands of what is not known exactly"


def bands_sheet(
    machine: Machine, bands: Bands, rows: Mapping[str, FrequencyBand], notes: str = ""
) -> Sheet:
    """Lowest frequencies of today's machine, and of a new one with its gain, by name.

    Args:
        machine: today's machine.
        bands: what is not known exactly.
        rows: at the poses of one workspace.
        notes: what else there is to say.
    """
    frequencies = [(b.low.frequency, b.nominal, b.high.frequency) for b in rows.values()]
    texts = [
        (name, *(f"{frequency:.3f} Hz" for frequency in own))
        for name, own in zip(rows, frequencies, strict=True)
    ]
    if len(frequencies) > 1:
        pairs = zip(*frequencies, strict=True)
        gains = (percent(new / old - 1) if old > 0 else "" for old, new in pairs)
        texts.append(("gain", *gains))
    outside = not all(
        low * (1 - SAME) <= own <= high * (1 + SAME) for low, own, high in frequencies
    )
    file = "; the file's own values lie outside of these bands" if outside else ""
    return Sheet(
        title=BANDS_TITLE,
        columns=("", *end_names(machine, bands)),
        rows=tuple(texts),
        note=f"{widths(machine, bands)}{file}{notes}",
        bold=(len(texts) - 1,),
    )


def end_names(machine: Machine, bands: Bands) -> tuple[str, str, str]:
    """Names of the columns: of the lowest frequency, that at the file's values, the highest."""
    if len(bands.ends) == 1:  # only masses differ
        return "lowest", "at file values", "highest"
    stiffest = bands.at_end(machine, bands.ends[-1])
    yields = stiffest.springs or any(one.compliance > 0 for one in stiffest.actuators)
    other_oil = bands.air or {bands.bulk_modulus, bands.dead_volume} != {EXACT}
    return "softest", "at file values", "stiffest" if yields or other_oil else "rigid"


def widths(machine: Machine, bands: Bands) -> str:
    """The ends of all bands, in words."""
    notes = []
    if structures := _structures(bands):
        oil = "today's oil without air" if machine.fluid.air else "today's oil"
        notes.append(f"{structures} × as soft as {oil}")
    if bands.spring_stiffness != EXACT:
        notes.append(f"springs {_span(bands.spring_stiffness)} × as stiff")
    shares = {
        "oil": bands.bulk_modulus,
        "dead volume": bands.dead_volume,
        "payload": bands.payload,
        "links": bands.link_mass,
    }
    notes += [f"{name} {_span(band)} ×" for name, band in shares.items() if band != EXACT]
    if bands.air:
        low, high = bands.air
        notes.append(f"entrained air {_span((100 * low, 100 * high))} %")
    assumed = ", assumed: the file states none" if is_assumed(machine, bands) else ""
    return ", ".join(notes) + assumed


def is_assumed(machine: Machine, bands: Bands) -> bool:
    """Whether the bands belong to a machine whose file states none."""
    return bands == Bands.shown(machine) != Bands.of(machine)


def _structures(bands: Bands) -> str:
    """Bands of structure, of all actuators and of single ones."""
    named = [f"{name} {_span(band)}" for name, band in (bands.structures or {}).items()]
    if bands.structure is None:
        return f"structure of {', '.join(named)}" if named else ""
    return ", ".join([f"structure {_span(bands.structure)}", *(f"of {one}" for one in named)])


def _span(band: tuple[float, float]) -> str:
    """A band in words; one value where its ends are alike."""
    low, high = (f"{value:.4g}" for value in band)
    return low if low == high else f"{low} to {high}"
