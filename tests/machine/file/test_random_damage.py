"""Files with random damage: each loads and answers, or is refused with one clear line, in time."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

import armdesign as ad
from tests import machines
from tests.checks import no_longer_than
from tests.machine.file.bad_files import SLOWEST, answers, assert_clear, without_visuals
from tests.machine.file.damage import damaged_bytes

SMALL = ("excavator_20t", "loader_crane", "mini_excavator_2t", "patu_boom", "spatial")


PER_MACHINE = 200  # times the machines: a thousand files, and a thousand URDFs


def refusal(path: Path, use: str) -> str:
    """The message with which a file is refused, by reading it or by asking the machine; "" if it
    answers.
    """
    folder, loaded = str(path.parent), False
    with no_longer_than(SLOWEST):
        try:
            machine = ad.load(path)
            loaded = True
            answers(machine, use)
        except ad.ArmDesignError as error:
            message = str(error).replace(f"{folder}/", "")
            assert_clear(message)
            assert "; " in message or loaded, f"no remedy: {message}"
            file = message.partition(": ")[0]
            assert loaded or file == "x.toml" or f'"{file}"' in path.read_text(encoding="utf-8"), (
                message
            )
            if "not valid TOML" in message or "not well-formed XML" in message:
                assert re.search(r"line \d+, column \d+\)", message), message
            return message
    return ""


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize("what", ["toml", "urdf"])
def test_random_damage(
    what: str, name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """200 seeded wounds of each file of five machines; nothing is printed on the way (parsers in
    C++ like to).
    """
    machine = machines.named(name)
    texts = {"toml": machine.text, "urdf": without_visuals(machine.urdf_text)}
    files = {"toml": tmp_path / "x.toml", "urdf": tmp_path / machine.section.urdf}
    for kind, file in files.items():
        file.write_text(texts[kind], encoding="utf-8")
    refused = 0
    for seed in range(PER_MACHINE):
        files[what].write_bytes(damaged_bytes(texts[what], random.Random(f"{name} {seed}")))
        try:
            refused += bool(refusal(files["toml"], "map" if seed % 10 == 0 else "modes"))
        except Exception as error:
            raise AssertionError(f"{name}, {what}, seed {seed}: {error!r}") from error
    assert PER_MACHINE / 4 < refused < PER_MACHINE
    assert capfd.readouterr() == ("", "")
