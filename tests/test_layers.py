"""Dependencies between the packages point one way, read from the imports."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "eskin"

# What each package may import, nearest first; what those may import is allowed too.
BELOW = {
    "errors": (),
    "transforms": (),
    "code_digest": (),
    "compiled": (),
    "structref_kernels": ("compiled",),
    "closing": (),
    "extras": ("errors",),
    "files": (),
    "plain_yaml": (),
    "units": (),
    "robot": ("transforms", "errors", "extras", "compiled"),
    "skin": ("robot", "files", "plain_yaml"),
    "touch": ("skin", "structref_kernels", "units"),
    "graph": ("touch",),
    "recording": ("touch",),
    "model": ("graph", "recording"),
    "nn": ("model",),
    "learn": ("nn", "live", "code_digest"),
    "drivers": ("recording", "closing"),
    "live": ("model", "recording"),
    "stream": ("live", "drivers"),
    "sim": ("recording",),
    "ur": (),
    "command": ("stream", "ur"),
    "page": ("transforms", "errors"),
    "viewer": ("stream", "page"),
    "demo": ("command", "viewer", "sim"),
    "bench": ("learn", "stream"),
}
# What the subpackages of each package may import of it; "" is its modules at the root.
INSIDE = {
    "drivers": {"": (), "virtual": ("",)},
    "learn": {
        "": (),
        "baselines": ("",),
        "events": ("",),
        "comparison": ("baselines", "events"),
    },
    "sim": {
        "": (),
        "contact": ("",),
        "people": ("contact",),
        "scene": ("people",),
        "sensor": ("",),
        "dataset": ("scene", "sensor"),
        "interactive": ("dataset",),
    },
}
TOP = {"cli", "app", "__init__"}
HEAVY = {"torch", "sklearn", "matplotlib"}
CORE = set(BELOW) - {"nn", "learn", "bench"}


def modules():
    return sorted(SOURCE.rglob("*.py"))


def package_of(path):
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


def imports_of(path, toplevel_only=False):
    """Full dotted names of everything the module imports."""
    tree = ast.parse(path.read_text())
    for node in tree.body if toplevel_only else ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module


def eskin_packages(path):
    parts = (name.split(".") for name in imports_of(path))
    return {p[1] for p in parts if p[0] == "eskin" and len(p) > 1}


def reachable(order, name):
    """Everything below a name in an order, however far."""
    below = set(order[name])
    return below.union(*(reachable(order, other) for other in below))


def allowed(package):
    return reachable(BELOW, package) | {"errors"}


def subpackage_of(package, parts):
    """The subpackage that the parts of a dotted name lie in; "" at the root."""
    is_folder = parts and (SOURCE / package / parts[0]).is_dir()
    return parts[0] if is_folder else ""


def subpackage_imports(package, path):
    """Subpackages that a module imports, and `__init__` for the package itself."""
    for name in imports_of(path):
        _, *parts = name.split(".")
        if name.startswith("eskin.") and parts[0] == package:
            yield subpackage_of(package, parts[1:]) if parts[1:] else "__init__"


def test_every_package_has_its_place_in_the_order():
    assert {package_of(path) for path in modules()} <= set(BELOW) | TOP


@pytest.mark.parametrize("package", sorted(BELOW))
def test_a_package_imports_only_what_lies_below_it(package):
    for path in modules():
        if package_of(path) == package:
            wrong = eskin_packages(path) - allowed(package) - {package}
            assert not wrong, f"{path.relative_to(SOURCE)} imports {sorted(wrong)}"


@pytest.mark.parametrize("package", sorted(INSIDE))
def test_a_subpackage_imports_only_what_lies_below_it(package):
    order = INSIDE[package]
    wrong = []
    for path in sorted((SOURCE / package).rglob("*.py")):
        parts = path.relative_to(SOURCE / package).parts
        if parts == ("__init__.py",):
            continue
        own = subpackage_of(package, parts)
        assert own in order, f"{package}/{own} has no place in the order"
        found = set(subpackage_imports(package, path))
        beyond = found - reachable(order, own) - {own}
        wrong += [
            f"{path.relative_to(SOURCE)} imports {b or 'the root'}" for b in beyond
        ]
    assert not wrong, wrong


def test_every_package_with_subpackages_states_their_order():
    nested = SOURCE.glob("*/*/**/*.py")
    assert {path.relative_to(SOURCE).parts[0] for path in nested} == set(INSIDE)


def test_modules_form_no_import_cycle():
    graph = {}
    for path in modules():
        name = ".".join(("eskin", *path.relative_to(SOURCE).with_suffix("").parts))
        if path.name != "__init__.py":
            graph[name] = set(imports_of(path, toplevel_only=True))
    TopologicalSorter(graph).prepare()


def test_the_core_never_imports_what_only_training_needs():
    for path in modules():
        if package_of(path) in CORE:
            heavy = {n.split(".")[0] for n in imports_of(path, True)} & HEAVY
            assert not heavy, f"{path.relative_to(SOURCE)} imports {sorted(heavy)}"


# Modules and calls by which bytes of others become code.
UNSAFE_MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle"}
UNSAFE_CALLS = {"yaml.unsafe_load", "yaml.full_load", "joblib.load", "eval", "exec"}
SAFE_WITH = {"torch.load": "weights_only=True", "yaml.load": "PlainLoader"}


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.stem)
def test_nothing_reads_what_could_run_code(path):
    nodes = list(ast.walk(ast.parse(path.read_text())))
    assert not UNSAFE_MODULES & {name.split(".")[0] for name in imports_of(path)}
    for call in (node for node in nodes if isinstance(node, ast.Call)):
        name, text = ast.unparse(call.func), ast.unparse(call)
        assert name not in UNSAFE_CALLS
        assert SAFE_WITH.get(name, "") in text
        assert "allow_pickle=True" not in text
