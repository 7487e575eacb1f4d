"""STUDY.toml: a sweep as data. Nothing in it is ever run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from armdesign.design.catalogue.sizes import read_sizes
from armdesign.errors import ArmDesignError, choose
from armdesign.machine.file import machine_file
from armdesign.machine.file.toml_reading import read_toml
from armdesign.machine.loading import shipped
from armdesign.machine.machine import Machine
from armdesign.sweeps.cases import by_key_path
from armdesign.sweeps.tasks import task_named

WAYS = {"grid": dict, "case": list, "csv": str, "sobol": dict}  # of saying what changes: one
KEYS = {
    "machine": (str, list),
    "task": (str,),
    "payloads": (list,),
    "points": (int, list),
    "requirements": (list,),
    "options": (dict, list),
    "outputs": (list,),
    **{way: (kind,) for way, kind in WAYS.items()},
}
WORDS = {str: "a text", list: "a list", dict: "a table", int: "a whole number"}


def read_study(path: Path, load: Callable[[str | Path], Machine]) -> dict[str, Any]:
    """Arguments of ``sweep`` that a study file states.

    Args:
        path: of the file; its machines and CSV file are relative to it.
        load: reads a machine.

    Raises:
        ArmDesignError: a file that cannot be read, or a key or value that no study has.
    """
    data = read_toml(machine_file.read_text(path), path.name)
    _check(data, path.name)
    task_named(data.get("task", "map"))
    names = data["machine"] if isinstance(data["machine"], list) else [data["machine"]]
    machines = [load(_machine(name, path)) for name in names]
    plain = ("task", "payloads", "points", "requirements", "outputs")
    return {
        "machine": machines,
        **_changes(data, path),
        **{key: data[key] for key in plain if key in data},
        **({"options": _options(data["options"], path)} if "options" in data else {}),
    }


def _options(options: Any, path: Path) -> Any:
    """Options of a study, or sets of them, with the sizes of a catalogue that is a file."""
    if isinstance(options, list):
        return [_options(one, path) for one in options]
    name = options.get("catalogue") if isinstance(options, dict) else None
    if isinstance(name, list):  # of metres, as in Python, or of millimetres?
        remedy = 'name a CSV file with columns bore_mm and rod_mm: catalogue = "sizes.csv"'
        raise ArmDesignError(f"{path.name}: options.catalogue", "is a list", remedy)
    if not (isinstance(name, str) and name.lower().endswith(".csv")):
        return options
    return options | {"catalogue": [list(pair) for pair in read_sizes(path.parent / name)]}


def _check(data: Mapping[str, Any], name: str) -> None:
    """Raise for keys that no study has, values of another kind, and changes said twice."""
    for key, value in data.items():
        if key not in KEYS:
            raise ArmDesignError(f"{name}: {key}", "no study has this key", choose(key, KEYS))
        if not isinstance(value, KEYS[key]) or isinstance(value, bool):
            kinds = " or ".join(WORDS[kind] for kind in KEYS[key])
            raise ArmDesignError(f"{name}: {key}", f"{value!r} is not allowed", f"give {kinds}")
    if "machine" not in data:
        remedy = 'give machine = "excavator_20t", or a list of machines'
        raise ArmDesignError(name, "names no machine", remedy)
    if len(ways := [way for way in WAYS if way in data]) > 1:
        fault = f"has {' and '.join(ways)}"
        raise ArmDesignError(name, fault, "leave all but one out")


def _machine(name: Any, path: Path) -> Path:
    """The path of a machine from the folder of the study, or of a shipped one."""
    if not isinstance(name, str) or not name:
        remedy = "give names or paths"
        raise ArmDesignError(f"{path.name}: machine", f"{name!r} is no machine", remedy)
    beside = path.parent / name
    if beside.is_file() or (beside / f"{beside.name}.toml").is_file():
        return beside
    return shipped().get(name, beside)


def _changes(data: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Changes of a study, as arguments of ``sweep``."""
    if "csv" in data:
        return {"changes": path.parent / data["csv"]}
    if "case" in data:
        part, cases = f"{path.name}: case", data["case"]  # others than tables are refused later
        return {"changes": [by_key_path(c, part) if isinstance(c, dict) else c for c in cases]}
    if "grid" in data:
        return {"changes": by_key_path(data["grid"], f"{path.name}: grid")}
    if "sobol" not in data:
        return {}
    sequence = dict(data["sobol"])
    for key in sequence:
        if key not in ("count", "seed", "ranges"):
            remedy = choose(key, ("count", "seed", "ranges"))
            raise ArmDesignError(f"{path.name}: sobol.{key}", "there is no such key", remedy)
    count, seed, ranges = (sequence.get(key) for key in ("count", "seed", "ranges"))
    seed = 0 if seed is None else seed
    for key, value in (("count", count), ("seed", seed)):
        if isinstance(value, bool) or not isinstance(value, int) or value < (key == "count"):
            fault = f"{value!r} is not allowed" if value is not None else "is missing"
            remedy = f"give a whole number of {int(key == 'count')} or more"
            raise ArmDesignError(f"{path.name}: sobol.{key}", fault, remedy)
    if not isinstance(ranges, dict):
        remedy = 'give a table [sobol.ranges] with lines as "cylinder.boom.bore_mm" = [100, 130]'
        raise ArmDesignError(f"{path.name}: sobol.ranges", "is missing", remedy)
    ranges = by_key_path(ranges, f"{path.name}: sobol.ranges")
    return {"changes": ranges, "sobol": count, "seed": seed}
