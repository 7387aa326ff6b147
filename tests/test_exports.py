"""Every name a package says it has can be had, and says what it is."""

import importlib
import pkgutil

import eskin

PACKAGES = ["eskin"] + [
    f"eskin.{module.name}"
    for module in pkgutil.iter_modules(eskin.__path__)
    if module.ispkg and module.name != "cli"
]


def test_every_exported_name_exists_and_is_documented():
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in module.__all__:
            thing = getattr(module, name)
            assert getattr(thing, "__doc__", None), f"{package}.{name} has no docstring"


def test_importing_eskin_does_not_import_torch():
    code = "import sys, eskin; assert not {'torch', 'sklearn'} & set(sys.modules)"
    import subprocess

    subprocess.run([importlib.sys.executable, "-c", code], check=True)
