"""Tests of reasons: each has a sentence and a remedy, and nobody reads them back."""

import ast
import importlib
import pickle
import string

import pytest

from eskin.command import Problem, Refusal, Trigger
from helpers.source import MODULES, SOURCE, name_module, parse_module

LAB = sorted((SOURCE.parents[1] / "lab").rglob("*.py"))
OTHERS_WORDS = (Problem.ORDER_FAILED, Problem.TOLD)
"""Causes whose sentence others wrote, with its remedy."""


def list_kinds():
    """Return the classes of causes, wherever they are in the source."""
    found = []
    for path in MODULES:
        for node in parse_module(path):
            if not isinstance(node, ast.ClassDef):
                continue
            if any(ast.unparse(base) == "Cause" for base in node.bases):
                module = importlib.import_module(name_module(path))
                found.append(getattr(module, node.name))
    return found


KINDS = list_kinds()
CAUSES = [pytest.param(cause, id=str(cause)) for kind in KINDS for cause in kind]


def list_values(cause):
    """Return the values that the texts of a cause name, each with an example."""
    texts = (cause.what, cause.remedy)
    fields = [part for text in texts for part in string.Formatter().parse(text)]
    return {name: 0.5 if spec else "word" for _, name, spec, _ in fields if name}


def test_kinds_of_causes_are_found():
    assert {Problem, Refusal, Trigger} < set(KINDS)


@pytest.mark.parametrize("cause", CAUSES)
def test_cause_is_a_sentence_with_a_remedy(cause):
    reason = cause.reason(**list_values(cause))
    assert reason.what and ";" not in reason.what
    assert not isinstance(cause, Trigger) or not reason.remedy
    assert bool(reason.remedy) or isinstance(cause, Trigger) or cause in OTHERS_WORDS
    assert str(reason) == "; ".join(filter(None, (reason.what, reason.remedy)))
    assert "{" not in str(reason) and "\n" not in str(reason)
    assert pickle.loads(pickle.dumps(reason)) == reason


@pytest.mark.parametrize("cause", CAUSES)
def test_problem_stands_apart_from_the_sentence_that_quotes_it(cause):
    """A problem is a clause or a noun, so no sentence goes on with it."""
    before, quoted, after = cause.what.partition("{problem}")
    if quoted:
        assert (before[-1:], after) == ("(", ")") or before.endswith(": ") and not after


@pytest.mark.parametrize("cause", CAUSES)
def test_reason_without_one_of_its_values_is_no_reason(cause):
    values = list_values(cause)
    for name in values:
        with pytest.raises(KeyError, match=name):
            cause.reason(**{key: values[key] for key in values if key != name})


@pytest.mark.parametrize("kind", KINDS)
def test_causes_of_a_kind_differ_and_each_is_used(kind):
    assert len(kind.__members__) == len(list(kind))
    used = {
        node.attr
        for path in MODULES
        for node in parse_module(path)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == kind.__name__
    }
    programs = {"TOLD"} if kind is Problem else set()
    assert used | programs == set(kind.__members__)


READING = {"split", "partition", "rpartition", "startswith", "endswith", "find"}
READING |= {"removeprefix", "removesuffix", "index", "count", "replace"}
"""Methods by which a text is read."""
SENTENCES = {"why", "remedy", "hold_reason"}
"""Attributes that hold the sentence of a reason."""


def find_read_sentences(tree):
    """Return the lines in which a sentence is compared, cut or searched.

    A sentence is that of a reason or an error. It may be broken into words, to be
    written on one line.
    """
    nodes = list(ast.walk(tree))
    errors = {node.name for node in nodes if isinstance(node, ast.ExceptHandler)}
    told = set()

    def is_sentence(node):
        match node:
            case ast.Attribute(attr=attribute):
                return attribute in SENTENCES
            case ast.Call(func=ast.Name(id="str"), args=[argument]):
                is_error = isinstance(argument, ast.Name) and argument.id in errors
                return is_error or is_sentence(argument)
            case ast.Subscript(value=ast.Attribute(attr="args")):
                return True
            case ast.Name(id=name):
                return name in told
        return False

    for node in nodes:
        if isinstance(node, ast.Assign) and is_sentence(node.value):
            told |= {one.id for one in node.targets if isinstance(one, ast.Name)}
    found = []
    for node in nodes:
        match node:
            case ast.Compare(left=left, ops=ops, comparators=others):
                texts = (ast.In, ast.NotIn, ast.Eq, ast.NotEq)
                is_text = any(isinstance(one, texts) for one in ops)
                if is_text and any(map(is_sentence, (left, *others))):
                    found.append(node.lineno)
            case ast.Call(func=ast.Attribute(value=value, attr=name), args=arguments):
                is_read = is_sentence(value) and name in READING
                plain = name == "split" and not arguments
                by_pattern = isinstance(value, ast.Name) and value.id == "re"
                searched = by_pattern and any(map(is_sentence, arguments))
                if (is_read and not plain) or searched:
                    found.append(node.lineno)
    return found


@pytest.mark.parametrize(
    "text",
    [
        "'stale' in event.why",
        "arm.hold_reason == 'closed'",
        "event.why.startswith('a')",
        "re.split(':', event.why)",
        "try: f()\nexcept OSError as error: print('a' in str(error))",
        "try: f()\nexcept OSError as error:\n  text = str(error)\n  print('a' in text)",
        "try: f()\nexcept OSError as error: print(error.args[0] == 'a')",
    ],
)
def test_sentence_that_is_read_is_found(text):
    assert find_read_sentences(ast.parse(text))


def test_nobody_reads_a_sentence_that_was_made_elsewhere():
    read = {
        str(path): find_read_sentences(ast.parse(path.read_text()))
        for path in (*MODULES, *LAB)
    }
    assert {path: lines for path, lines in read.items() if lines} == {}
