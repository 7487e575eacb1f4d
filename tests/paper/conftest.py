"""Configurations that several files look at."""

from __future__ import annotations

import pandas as pd
import pytest

import armdesign as ad
from armdesign.paper.configurations import Mechanism, grid
from armdesign.paper.errata import scan
from armdesign.paper.reproduction import Reproduction, reproduce
from tests.paper.dimensions import CORNERS, LENGTH, MASS


@pytest.fixture(scope="session")
def one() -> Mechanism:
    return grid(ad.load("paper_1dof"), (MASS,), (LENGTH,))


@pytest.fixture(scope="session")
def corners() -> Reproduction:
    return reproduce(**CORNERS)


@pytest.fixture(scope="session")
def scanned() -> pd.DataFrame:
    return scan()
