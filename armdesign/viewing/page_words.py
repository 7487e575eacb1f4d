"""Words of the viewer as HTML: readings, and the scale of colours; what files say is escaped."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

from armdesign.errors import printable
from armdesign.viewing.reading import FAULT, NO_BANDWIDTH, Reading, rows

if TYPE_CHECKING:
    from armdesign.viewing.region import ReachRegion

STYLE = """
#armdesign { padding: 0.3em 0.8em; font-size: 0.85em; line-height: 1.35 }
#armdesign th { text-align: left; font-weight: normal; opacity: 0.75 }
#armdesign :is(th, td) { padding-right: 0.8em; vertical-align: top }
#armdesign tr.heads th { font-weight: bold; opacity: 1 }
#armdesign p { margin: 0.5em 0 }
"""
SWATCH = "width:1.4em;height:0.8em;display:inline-block;background:"


def reading_words(readings: dict[str, Reading], swing: str, region: ReachRegion) -> str:
    """Readings of machines side by side, faults, the animation, and the scale of colours."""
    columns = {name: dict(rows(one)) for name, one in readings.items()}
    notes: dict[str, list[str]] = {}  # sentences, and whose they are
    for name, column in columns.items():
        for what in {FAULT, NO_BANDWIDTH} & column.keys():
            notes.setdefault(f"{what}: {column.pop(what)}", []).append(name)
    lines = []
    if len(columns) > 1 and any(columns.values()):
        heads = "".join(f"<th>{escaped(name)}</th>" for name in columns)
        lines.append(f'<tr class="heads"><th></th>{heads}</tr>')
    for what in dict.fromkeys(what for column in columns.values() for what in column):
        cells = "".join(
            f"<td>{escaped(column.get(what, '–'))}</td>" for column in columns.values()
        )
        lines.append(f"<tr><th>{escaped(what)}</th>{cells}</tr>")
    said = [
        note if len(names) == len(columns) else f"{' and '.join(names)}: {note}"
        for note, names in notes.items()
    ]
    paragraphs = "".join(f"<p>{escaped(note)}</p>" for note in [*said, swing] if note)
    return (
        f'<div id="armdesign"><style>{STYLE}</style><table>{"".join(lines)}</table>{paragraphs}'
        f"<p>{scale_words(region)}</p></div>"
    )


def scale_words(region: ReachRegion) -> str:
    """The scale of colours of the swept region."""
    swatches = "".join(f'<i style="{SWATCH}{colour}"></i>' for colour, _ in region.scale)
    ends = f"{region.least:.3g} Hz {swatches} {region.most:.3g} Hz and more"
    return f"{ends}<br>lowest frequency at each place of the tool, all load cases"


def escaped(text: str) -> str:
    """A text that can stand in HTML."""
    return html.escape(printable(text))
