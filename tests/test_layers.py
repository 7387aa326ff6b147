"""Tests of dependencies: packages import one way, and nothing reads code as data."""

import ast
import re
from graphlib import TopologicalSorter

import pytest

from eskin.registry import COMMANDS, LEARNING
from helpers.source import MODULES, SOURCE, name_module, parse_module

# What each package may import, nearest first; what those may import is allowed too.
PRODUCT = {
    "errors": (),
    "reasons": (),
    "units": (),
    "transforms": (),
    "files": (),
    "progress": (),
    "places": (),
    "entries": ("places",),
    "compiled": ("entries",),
    "near": (),
    "registry": ("errors",),
    "robot": ("transforms", "registry", "files", "compiled"),
    "skin": ("robot", "near", "progress", "units"),
    "touch": ("skin",),
    "recording": ("touch",),
    "live": ("recording",),
    "calibration": ("touch", "reasons"),
    "drivers": ("recording", "progress", "reasons"),
    "stream": ("live", "drivers"),
    "command": ("stream",),
    "page": ("command",),
    "bus": ("stream",),
    "notebook": ("page",),
    "app": ("command",),
    "cli": ("app", "bus", "calibration", "page"),
}
LEAVES = {
    "arms": ("command",),
    "design": ("cli",),
    "exports": ("cli", "notebook"),
    "labelling": ("cli",),
    "learn": ("cli",),
    "sets": ("cli",),
    "sim": ("arms", "labelling", "sets"),
}
"""Optional packages, which nothing in the product imports."""
BELOW = PRODUCT | LEAVES
# What the subpackages of each package may import of it; "" is its modules at the root.
INSIDE = {
    "design": {"": (), "formats": (), "commands": ("", "formats")},
    "exports": {"": (), "commands": ("",)},
    "labelling": {"": (), "commands": ("",)},
    "learn": {"": ("nn",), "nn": (), "events": ("",), "commands": ("events",)},
    "sets": {"": (), "commands": ("",)},
    "sim": {
        "": (),
        "virtual": (),
        "contact": ("",),
        "people": ("contact",),
        "scene": ("people",),
        "sensor": ("",),
        "dataset": ("scene", "sensor"),
        "interactive": ("dataset",),
        "demo": ("interactive",),
        "bench": ("virtual",),
        "commands": ("demo", "bench"),
    },
}
TOP = {"__init__", "__main__"}
"""The public names and the program stand above everything, and nothing imports them."""
NAMES = {name_module(path).removesuffix(".__init__"): path for path in MODULES}
"""Paths of all modules, by their dotted names."""
REGISTRY = "registry"
"""The only module of the product that names leaves, for commands and sources."""
HEAVY = {"torch", "sklearn", "matplotlib"}
CORE = set(BELOW) - {"learn"}
# Modules and calls by which bytes of others become code.
UNSAFE_MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle"}
UNSAFE_CALLS = {"yaml.unsafe_load", "yaml.full_load", "joblib.load", "eval", "exec"}
SAFE_WITH = {"torch.load": "weights_only=True", "yaml.load": "PlainLoader"}


def get_package(path):
    """Return the package of a module, or the name of one at the root."""
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


def find_imports(path, when_loaded=False):
    """Yield the full dotted names of what a module imports, or imports when loaded.

    Without `when_loaded` imports inside functions and under `TYPE_CHECKING` are among
    them. A module that is imported from its package has the name of the module.
    """
    module, *nodes = parse_module(path)
    for node in module.body if when_loaded else nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            modules = [name for name in inner if name in NAMES]
            yield from modules
            if len(modules) < len(inner):
                yield node.module


def find_below(order, name):
    """Return all that lies below a name in an order, however far."""
    below = set(order[name])
    return below.union(*(find_below(order, other) for other in below))


def get_subpackage(package, parts):
    """Return the subpackage of the parts of a dotted name; "" is the root."""
    is_folder = parts and (SOURCE / package / parts[0]).is_dir()
    return parts[0] if is_folder else ""


def find_subpackage_imports(package, path):
    """Yield subpackages that a module imports, `__init__` for the package itself."""
    for name in find_imports(path):
        _, *parts = name.split(".")
        if name.startswith("eskin.") and parts[0] == package:
            yield get_subpackage(package, parts[1:]) if parts[1:] else "__init__"


def test_every_package_has_its_place_in_the_order():
    assert {get_package(path) for path in MODULES} <= set(BELOW) | TOP
    nested = SOURCE.glob("*/*/**/*.py")
    assert {path.relative_to(SOURCE).parts[0] for path in nested} == set(INSIDE)


@pytest.mark.parametrize("package", sorted(BELOW))
def test_package_imports_only_what_lies_below_it(package):
    allowed = find_below(BELOW, package) | {"errors", package}
    for path in MODULES:
        if get_package(path) == package:
            names = [name.split(".") for name in find_imports(path)]
            # `eskin` itself has the public names, which stand above everything.
            found = {"".join(parts[1:2]) for parts in names if parts[0] == "eskin"}
            assert found <= allowed, path


@pytest.mark.parametrize("package", sorted(INSIDE))
def test_subpackage_imports_only_what_lies_below_it(package):
    for path in sorted((SOURCE / package).rglob("*.py")):
        parts = path.relative_to(SOURCE / package).parts
        if parts != ("__init__.py",):
            own = get_subpackage(package, parts)
            allowed = find_below(INSIDE[package], own) | {own}
            assert set(find_subpackage_imports(package, path)) <= allowed, path


def test_nothing_imports_the_laboratory_and_the_product_no_leaf():
    assert not set(LEAVES) & set().union(*(find_below(BELOW, n) for n in PRODUCT))
    for path in MODULES:
        assert "lab" not in {name.split(".")[0] for name in find_imports(path)}, path


def test_modules_are_imported_by_name_only_where_that_is_listed():
    """Names in strings are of the module's own package, or the registry's."""
    pattern = re.compile(r"""["'](?:eskin\.)?([a-z_]+)(?:\.[a-z_.]+)?["']""")
    for path in MODULES:
        package = get_package(path)
        for node in parse_module(path):
            if not (isinstance(node, ast.Call) and node.args):
                continue
            if ast.unparse(node.func).split(".")[-1] != "import_module":
                continue
            match = pattern.fullmatch(ast.unparse(node.args[0]))
            named = match[1] if match else ""
            if package not in TOP and package != REGISTRY:
                assert named == package or named not in BELOW, path


def test_only_the_registry_names_leaves():
    pattern = re.compile(rf"""["'](?:eskin\.)?(?:{"|".join(LEAVES)})\.""")
    whole = re.compile(rf"""["']eskin\.(?:{"|".join(LEAVES)})["']""")
    for path in MODULES:
        package = get_package(path)
        if package not in LEAVES and package != REGISTRY:
            text = path.read_text()
            assert not pattern.search(text) and not whole.search(text), path


def test_packages_have_no_cycle_and_their_arrows_are_printed(capsys):
    below = {package: set() for package in BELOW}
    for path in MODULES:
        for name in find_imports(path):
            pair = get_package(path), *name.split(".")[1:2]
            if name.startswith("eskin.") and pair[0] in BELOW and pair[0] != pair[1]:
                below[pair[0]].add(pair[1])
    depth = {}
    for package in TopologicalSorter(below).static_order():
        depth[package] = 1 + max((depth[each] for each in below[package]), default=0)
    with capsys.disabled():
        print(
            f"\n{len(below)} packages and root modules, depth {max(depth.values())}, "
            f"{sum(map(len, below.values()))} arrows"
        )


def test_modules_form_no_cycle_by_any_import():
    graph = {name: set(find_imports(path)) for name, path in NAMES.items()}
    TopologicalSorter(graph).prepare()


def test_names_by_which_the_registry_imports_are_those_of_packages_with_commands():
    packages = {entry.target.split(".")[0] for entry in COMMANDS.values()}
    assert packages == {"cli"} | set(LEAVES) - {"arms"}
    assert LEARNING == "eskin.learn.commands.models"


def test_core_imports_no_package_of_training():
    for path in MODULES:
        if get_package(path) in CORE:
            names = {
                name.split(".")[0] for name in find_imports(path, when_loaded=True)
            }
            assert not names & HEAVY, path


def test_no_module_runs_code_that_it_reads():
    for path in MODULES:
        names = {name.split(".")[0] for name in find_imports(path)}
        assert not names & UNSAFE_MODULES, path
        for node in parse_module(path):
            if isinstance(node, ast.Call):
                name = ast.unparse(node.func)
                text = ast.unparse(node)
                assert name not in UNSAFE_CALLS, path
                assert SAFE_WITH.get(name, "") in text, path
                assert "allow_pickle=True" not in text, path


@pytest.mark.parametrize("name", ["skin.yaml", "robot.urdf", "calibration.json"])
def test_file_that_skins_and_recordings_hold_is_named_once(name):
    """Others import the name, so that no two places look for another file."""
    nodes = [node for path in MODULES for node in parse_module(path)]
    texts = [node.value for node in nodes if isinstance(node, ast.Constant)]
    assert texts.count(name) == 1


def find_classes(paths):
    """Return the names of all classes in some modules."""
    nodes = (node for path in paths for node in parse_module(path))
    return [node.name for node in nodes if isinstance(node, ast.ClassDef)]


def test_no_class_name_stands_for_two_things():
    names = find_classes(MODULES)
    assert len(set(names)) == len(names)
    lab = SOURCE.parents[1] / "lab"
    assert not set(names) & set(find_classes(lab.rglob("*.py")))
