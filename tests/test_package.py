"""The house: imports point downwards, heavy doors stay shut, files are short, docstrings hold."""

from __future__ import annotations

import ast
import importlib
import inspect
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from operator import attrgetter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "armdesign"

# From the ground up: a module imports from its own room and from those above it in this list only.
ROOMS = (
    *(
        "units",
        "errors",
        "arguments",
        "package_files",
        "text_files",
        "csv_rows",
        "streams",
        "user_folders",
        "transaction",
        "arrays",
        "threads",
        "processes",
        "short_repr",
        "progress",
    ),
    *("journal", "hydraulics", "mechanism", "machine", "frequency", "inspection", "calibration"),
    *("design.catalogue.sizes", "design.requirements", "design.program", "design.search"),
    *("design.catalogue", "design.bound", "design"),
    *("simulation.plant", "simulation.excitation", "simulation.identification", "simulation"),
    *("control", "bandwidth_search", "optimization", "motion"),
    *("drawing", "exchange", "plots", "viewing", "report", "paper", "influence", "sweeps"),
    *("output", "option_values", "options", "json_document", "runs"),
    "output_reports",
    *(
        "cli_control",
        "cli_draw",
        "cli_measured",
        "cli_sweep",
        "cli_tradeoffs",
        "cli_influence",
        "cli_motion",
        "cli_paper",
        "cli_report",
        "cli_export",
        "cli_view",
        "cli",
        "__main__",
    ),
)
DOORS = {  # library: the only modules that may import it
    "pinocchio": {"mechanism.arm", "simulation.plant.rigid_bodies"},
    "ezdxf": {"exchange.dxf"},
    "matplotlib": {"plots.canvas", "plots.layout"},
    "shapely": {"drawing.outlines"},
    "viser": {"viewing.stage"},
    "websockets": {"viewing.stage"},
    "coal": {"drawing.visuals"},
    "cvxpy": {"design.search.semidefinite"},
    "tomlkit": {"machine.file.toml_writing", "machine.provenance"},
    "pydantic": {
        *("machine.file.section", "machine.file.links", "machine.file.schema"),
        *("machine.file.schema_faults", "machine.file.machine_file"),
        *("report.contents", "json_document"),
    },
    "typer": {"cli", "options"},
    "jinja2": {"report.page"},
    "bokeh": {"report.interactive"},
    "PIL": {"plots.palette", "report.page"},
    "control": {"simulation.linear_model"},
    "distributed": {"sweeps.cluster"},
    "threadpoolctl": {"threads"},
    "numba": {"simulation.plant.compiled"},
}


def name_of(path: Path) -> str:
    """Name of a module below the package's; a room's own name is its ``__init__``'s."""
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__")


@cache
def parsed(folder: Path) -> dict[Path, ast.Module]:
    """The modules below a folder."""
    return {p: ast.parse(p.read_text(encoding="utf-8")) for p in sorted(folder.rglob("*.py"))}


@cache
def sources() -> dict[str, ast.Module]:
    """The modules of the package by name, without rooms that only have a name."""
    return {
        name_of(path): tree
        for path, tree in parsed(PACKAGE).items()
        if path.name != "__init__.py" or (path.parent != PACKAGE and len(tree.body) > 1)
    }


@cache
def nodes(tree: ast.Module) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree))


def room_of(module: str) -> int:
    """The place in ``ROOMS`` of the longest name that the module's begins with."""
    return max(
        (len(room), n) for n, room in enumerate(ROOMS) if f"{module}.".startswith(f"{room}.")
    )[1]


def for_type_checkers(tree: ast.Module) -> set[ast.AST]:
    blocks = [n for n in nodes(tree) if isinstance(n, ast.If)]
    typing = [block for block in blocks if "TYPE_CHECKING" in ast.unparse(block.test)]
    return {node for block in typing for child in block.body for node in ast.walk(child)}


SHOWING = ("plot", "_repr_html_")


def inside_plot(tree: ast.Module) -> set[ast.AST]:
    """What is in methods by which results draw or show themselves: they open the door to it."""
    functions = [n for n in nodes(tree) if isinstance(n, ast.FunctionDef)]
    methods = [function for function in functions if function.name in SHOWING]
    return {node for method in methods for node in ast.walk(method)}


@cache
def imports(tree: ast.Module, *, drawing: bool = True) -> set[str]:
    """Dotted names of all imports, inside functions too, but not those for type checkers alone."""
    left_out = for_type_checkers(tree) | (set() if drawing else inside_plot(tree))
    names: set[str] = set()
    for node in nodes(tree):
        if node in left_out:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "absolute imports only"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@cache
def own(tree: ast.Module) -> set[str]:
    """Modules of the package that a module imports, but for those with which its results draw
    themselves.
    """
    modules = set()
    for name in imports(tree, drawing=False):
        words = name.split(".")
        if words[0] == "armdesign" and words[1] not in ("__version__", "_BEGAN"):
            starts = (".".join(words[1:n]) for n in range(len(words), 1, -1))
            modules.add(next(start for start in starts if start in sources()))
    return modules


@pytest.mark.parametrize("folder", ["armdesign", "benchmarks", "studies", "tests"])
def test_files_and_functions_are_short(folder: str) -> None:
    """Files below 450 lines, and bodies without their docstring below 40."""
    for path, tree in parsed(ROOT / folder).items():
        assert len(path.read_text(encoding="utf-8").splitlines()) < 450, path
        for node in nodes(tree):
            if isinstance(node, ast.FunctionDef):
                body = node.body[1:] if ast.get_docstring(node) else node.body
                lines = body[-1].end_lineno - body[0].lineno + 1 if body else 0
                assert lines < 40, f"{path}: {node.name}"


@pytest.mark.parametrize("folder", ["armdesign", "benchmarks", "studies", "tests"])
def test_functions_have_few_parameters(folder: str) -> None:
    """At most 8; options that belong together are a ``TypedDict`` or a group of ``runs``."""
    for path, tree in parsed(ROOT / folder).items():
        for node in nodes(tree):
            if isinstance(node, ast.FunctionDef):
                own = [name for name in parameters(node) if name not in ("self", "cls")]
                assert len(own) <= 8, f"{path}: {node.name}"


def test_options_of_functions_are_spelled_out() -> None:
    """Python lets any keyword pass that ``**options`` takes; ``with_options`` does not."""
    for module, tree in sources().items():
        for node in nodes(tree):
            if isinstance(node, ast.FunctionDef) and (kind := unpacked(node)):
                calls = [one for one in node.decorator_list if isinstance(one, ast.Call)]
                kinds = [
                    ast.unparse(one.args[0]) for one in calls if "with_options" in ast.dump(one)
                ]
                assert kinds == [kind], f"{module}.{node.name}"


def test_every_room_is_there() -> None:
    assert {room_of(module) for module in sources()} == set(range(len(ROOMS)))


def test_imports_point_downwards() -> None:
    for module, tree in sources().items():
        above = {other for other in own(tree) if room_of(other) > room_of(module)}
        assert not above, module


def test_no_module_imports_itself_by_way_of_others() -> None:
    TopologicalSorter({module: own(tree) for module, tree in sources().items()}).prepare()


def test_simulation_and_design_do_not_know_each_other() -> None:
    for module, tree in sources().items():
        for one, other in (("design", "simulation"), ("simulation", "design")):
            if module.startswith(f"{one}."):
                assert not {name for name in own(tree) if name.startswith(f"{other}.")}, module


@pytest.mark.parametrize("library", DOORS)
def test_each_library_has_its_door(library: str) -> None:
    users = {
        module
        for module, tree in sources().items()
        if library in {name.split(".")[0] for name in imports(tree)}
    }
    assert users <= DOORS[library]


def test_importing_the_package_loads_no_heavy_library() -> None:
    """In a process of its own: `import armdesign` and the command line's module."""
    heavy = [
        "pinocchio",
        "cvxpy",
        "matplotlib",
        "pandas",
        "scipy",
        "numpy",
        "joblib",
        "pydantic",
        "numba",
    ]
    code = (
        f"import sys, armdesign, armdesign.cli\nprint([name for name in {heavy} if name in"
        " sys.modules])\narmdesign.load, armdesign.optimize\nprint([name for name in ('cvxpy',"
        " 'matplotlib', 'pandas', 'pinocchio') if name in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == ["[]", "[]"], run.stdout


def test_a_map_loads_no_library_that_it_does_not_need(tmp_path: Path) -> None:
    """In a process of its own, with all files that it writes."""
    others = ["pandas", "cvxpy", "numba", "joblib", "matplotlib.pyplot"]
    code = (
        "import sys\nfrom armdesign.cli import app\n"
        f"app(['map', 'paper_1dof', '-q', '--out', {str(tmp_path)!r}], standalone_mode=False)\n"
        f"print([name for name in {others} if name in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == ["[]"], run.stdout


def test_public_names() -> None:
    """DESIGN's table; every name that is listed is there, and the rest is an AttributeError."""
    import armdesign as ad

    for name in ad.__all__:
        assert getattr(ad, name) is not None
        assert name in dir(ad)
    assert {name for name in dir(ad) if not name.startswith("__")} == set(ad.__all__)
    core = {
        "load",
        "Machine",
        "natural_modes",
        "Modes",
        "Poses",
        "Workspace",
        "frequency_map",
        "FrequencyMap",
    }
    more = {
        "Requirements",
        "optimize",
        "size_cylinders",
        "Design",
        "simulate",
        "validate",
        "Validation",
        "linearize",
    }
    assert core | more | {"ArmDesignError", "formulas"} <= set(ad.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = ad.nothing


# -------------------------------------------------------------------------------------- docstrings


def public(tree: ast.Module) -> list[tuple[str, ast.FunctionDef | ast.ClassDef]]:
    """Public functions, classes and methods."""
    definitions: list[tuple[str, ast.FunctionDef | ast.ClassDef]] = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            definitions.append((node.name, node))
            if isinstance(node, ast.ClassDef):
                methods = [
                    m
                    for m in node.body
                    if isinstance(m, ast.FunctionDef) and not m.name.startswith("_")
                ]
                definitions += [(f"{node.name}.{m.name}", m) for m in methods]
    return definitions


def section(docstring: str, title: str) -> list[str]:
    """Names that a Google-style section lists, at its first level of indentation."""
    lines = docstring.splitlines()
    if f"{title}:" not in (line.strip() for line in lines):
        return []
    start = next(i for i, line in enumerate(lines) if line.strip() == f"{title}:")
    indent = len(lines[start]) - len(lines[start].lstrip())
    names = []
    for line in lines[start + 1 :]:
        depth = len(line) - len(line.lstrip())
        if line.strip() and depth <= indent:
            break
        if depth == indent + 4 and ":" in line:
            names += [word.strip().strip("*`") for word in line.split(":")[0].split(",")]
    return names


def parameters(function: ast.FunctionDef) -> list[str]:
    arguments = function.args
    known = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    return [a.arg for a in (*known, arguments.vararg, arguments.kwarg) if a]


def unpacked(function: ast.FunctionDef) -> str:
    """The ``TypedDict`` whose keys a function takes, ``**options: Unpack[…]``; empty: none."""
    last = function.args.kwarg
    match last and last.annotation:
        case ast.Subscript(value=ast.Name(id="Unpack"), slice=kind):
            return ast.unparse(kind)
    return ""


def spelled_out(module: str, name: str) -> set[str]:
    """Arguments that a function shows, options that it shares with others among them."""
    function = attrgetter(name)(importlib.import_module(f"armdesign.{module}"))
    return set(inspect.signature(function).parameters)


def fields(kind: ast.ClassDef) -> set[str]:
    """Names of attributes and methods, and of what is assigned in ``__init__``."""
    typed = (f.target for f in kind.body if isinstance(f, ast.AnnAssign))
    methods = {m.name: m for m in kind.body if isinstance(m, ast.FunctionDef)}
    names = {target.id for target in typed if isinstance(target, ast.Name)} | set(methods)
    if init := methods.get("__init__"):
        names |= {n.attr for n in ast.walk(init) if isinstance(n, ast.Attribute)}
        names |= set(parameters(init))
    return names


def test_docstrings_say_what_the_code_has() -> None:
    """Every public thing has one that ends its first line as a sentence; the names it lists
    exist.
    """
    for module, tree in sources().items():
        assert ast.get_docstring(tree), f"{module} has no docstring"
        for name, node in public(tree):
            text = ast.get_docstring(node)
            assert text, f"{module}.{name} has no docstring"
            first = text.splitlines()[0]
            assert first.rstrip()[-1] in ".:;?!", f"{module}.{name}: {first}"
            listed = set(section(text, "Args"))
            if isinstance(node, ast.FunctionDef):
                known = spelled_out(module, name) if unpacked(node) else set(parameters(node))
                if listed and (node.args.kwarg is None or unpacked(node)):
                    assert known - {"self", "cls"} == listed, f"{module}.{name}"
            else:
                known = fields(node)
                listed |= set(section(text, "Attributes"))
            assert listed <= known, f"{module}.{name} has no {listed - known}"


def test_messages_did_not_lose_their_f() -> None:
    """A string with a name in braces is formatted, unless it is a documented template."""
    for module, tree in sources().items():
        strings = [node.values for node in nodes(tree) if isinstance(node, ast.JoinedStr)]
        formatted = {id(part) for values in strings for part in values}
        said = [node for node in nodes(tree) if isinstance(node, ast.Raise | ast.Call)]
        parts = {id(part): part for node in said for part in ast.walk(node)}
        for part in (part for name, part in parts.items() if name not in formatted):
            if isinstance(part, ast.Constant) and isinstance(part.value, str):
                names = [text.split("}")[0] for text in part.value.split("{")[1:] if "}" in text]
                plain = [name.replace("_", "a").replace(".", "a") for name in names]
                assert not any(map(str.isalnum, plain)), f"{module}: {part.value}"
