"""The kinds of linkage that a machine file can give; ``Linkage`` says how to add one."""

from __future__ import annotations

from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.linkage.direct import Direct
from armdesign.mechanism.linkage.four_bar import FourBar

KINDS: tuple[type[Linkage], ...] = (Direct, FourBar)
