"""Tests of names and docstrings: exports exist, and docstrings are sentences.

Functions begin with an imperative, which ruff checks (D401). Modules, classes and
properties have a finite verb in their first sentence. Docstrings of fields are noun
phrases, but never begin in the middle of one.
"""

import ast
import importlib
import pkgutil
import re

import pytest

import eskin
from helpers.source import MODULES, SOURCE, parse_module

pytestmark = pytest.mark.slow

PACKAGES = ["eskin"] + [
    name
    for _, name, is_package in pkgutil.walk_packages(eskin.__path__, "eskin.")
    if is_package
]
VERBS = set(
    """
    accept accumulate act add adjust advance aggregate agree align allocate allow answer
    appear append apply approximate are arrange arrive ask assemble assign attach
    augment begin belong bend bind bound break bring buffer build calculate calibrate
    call can cannot carry change check choose classify clear click close collect color
    come command commit compare compile complete compose compress compute concern
    configure connect consist construct consume contain continue control convert copy
    correct correspond corrupt count cover create cross cut deal decide declare decode
    define deform delay delete deliver depend derive describe detect determine differ
    discard display divide do draw drift drive drop emit enable encode end enter equal
    estimate evaluate execute expect expire export expose express extend extract fail
    feed feel fetch fill filter find finish fit fix flush fold follow forget form format
    forward freeze generate get give go grow guard guide handle happen has have help
    hold identify ignore implement import include indicate infer inherit initialise
    integrate interpolate invalidate is iterate join judge keep know label last lay lead
    learn leave let lie lift limit link list listen load log look lose make map mark
    mask match may mean measure merge mirror mix model modify monitor mount move
    multiply must name need negotiate normalise note notice notify obey observe occur
    offer open operate optimise order own pack pad parse pass pause perform permit pick
    place plan play plot point pool post predict prepare preserve press prevent print
    process produce project propagate protect provide publish pull push put queue raise
    react read reassemble receive recognise recognises recompute record recover reduce
    refer reflect refuse reject release rely remain remember remove rename render repeat
    replace replay report represent request require resample reset resize resolve
    respond rest restore result resume retry return rotate run sample satisfy save say
    scale schedule score see segment select send separate serialise serve set settle
    shape share shift show simulate sit skip slide smooth solve sort speak specify spend
    split stack stamp stand start state stay step stop store stream stretch subtract
    suit summarise supply support switch synchronise take tell terminate test touch
    trace track train transform translate transmit transport travel try tune turn undo
    unpack unroll update use validate vary verify view wait walk want warn watch wear
    weigh work wrap write yield
    """.split()
)
IRREGULAR = {"does", "goes", "passes", "presses", "tries", "applies", "carries"}
FRAGMENTS = {"of", "by", "whom", "whose", "as", "from", "to", "with", "than", "that"}


def test_exported_names_exist_and_are_documented():
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in getattr(module, "__all__", ()):
            assert getattr(module, name).__doc__, f"{package}.{name}"


def is_verb(word):
    """Tell whether a word is a finite verb of the list."""
    word = word.lower()
    bases = {word, word.removesuffix("s"), word.removesuffix("es")}
    if word.endswith("ies"):
        bases.add(word.removesuffix("ies") + "y")
    return word in IRREGULAR or bool(bases & VERBS)


def get_first_sentence(text):
    """Return a docstring up to its first full stop or blank line."""
    paragraph = text.strip().split("\n\n")[0]
    return re.split(r"(?<=[a-z0-9`)\]])[.:](?:\s|$)", paragraph)[0]


def find_field_docstrings(path):
    """Yield the docstrings under fields and constants of a module."""
    for node in parse_module(path):
        body = getattr(node, "body", None)
        pairs = zip(body, body[1:], strict=False) if isinstance(body, list) else ()
        for before, after in pairs:
            text = getattr(getattr(after, "value", None), "value", None)
            is_field = isinstance(before, ast.AnnAssign | ast.Assign)
            if is_field and isinstance(after, ast.Expr) and isinstance(text, str):
                yield text


def test_docstrings_of_modules_and_classes_are_sentences():
    wrong = [
        f"{path.relative_to(SOURCE)}: {text.splitlines()[0]}"
        for path in MODULES
        for node in parse_module(path)
        if isinstance(node, ast.Module | ast.ClassDef)
        and (text := ast.get_docstring(node))
        and not any(map(is_verb, re.findall("[A-Za-z]+", get_first_sentence(text))))
    ]
    assert not wrong


def test_docstrings_of_fields_do_not_begin_in_the_middle():
    wrong = [
        f"{path.relative_to(SOURCE)}: {text.splitlines()[0]}"
        for path in MODULES
        for text in find_field_docstrings(path)
        if re.findall("[A-Za-z]+", text)[0].lower() in FRAGMENTS
    ]
    assert not wrong
