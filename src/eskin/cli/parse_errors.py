"""This module rewrites the errors of tyro, which parses the arguments of commands.

tyro draws boxes, and speaks of types of Python. What it says is reduced to one line
that names the option, the given and the allowed values, and what to do. tyro makes its
errors public as printed text alone: their classes are in `tyro._errors`, which may
change with any release. So this is the one module that reads sentences of another
program, and a test compares its patterns with the output of the installed tyro.
"""

import re
from collections.abc import Callable, Sequence
from difflib import get_close_matches

from eskin.units import format_count

BOX = {ord(character): " " for character in "╭╮╰╯│─├┤"}
KINDS = {
    "INT": "a whole number",
    "FLOAT": "a number",
    "PATH": "a path",
    "STR": "a name",
}
"""Descriptions of what tyro names by its type."""
TITLES = "Parsing error|Value error|Unrecognized options|Required options"
TITLES += "|Missing argument|Invalid choice"


def rewrite_parse_error(message: str, name: str, options: Sequence[str] = ()) -> str:
    """Return an error of tyro as one line.

    Args:
        message: what tyro printed.
        name: name of the program with its command, such as `eskin run`.
        options: options of the command.
    """
    text = re.sub(rf"^(?:{TITLES}) ", "", flatten(message))
    unknown = re.search(r"Unrecognized options: ([^\s,]+)", text)
    if unknown is not None:
        return f"{describe_unknown(unknown[1], options)}; see {name} --help"
    for pattern, describe in REWRITTEN:
        found = re.search(pattern, text)
        if found is not None:
            return f"{describe(found)}; see {name} --help"
    return f"{name}: {text}"


def flatten(message: str) -> str:
    """Return the words of a message, without the box drawn around them."""
    words = message.translate(BOX).split()
    text = " ".join(word for word in words if not re.fullmatch("[-+|]{3,}", word))
    # tyro calls the command and its output `0` and `1`.
    text = re.sub(r"(?<![\w.])[01]\.(?=[a-z])", "", text)
    return re.split(r" (?:Argument helptext:|For full helptext)", text)[0]


def describe_unknown(unknown: str, options: Sequence[str]) -> str:
    """Describe an option that the command does not have, with the one it is like."""
    short = {f"--{one.rpartition('.')[2].lstrip('-')}": one for one in options}
    like = get_close_matches(unknown, [*options, *short], 1)
    remedy = "take it out, or correct it"
    if like:
        remedy = f"did you mean {short.get(like[0], like[0])}?"
    return f"{unknown} is no option or argument of the command; {remedy}"


def describe_missing(found: re.Match[str]) -> str:
    """Describe the first argument that is required, by what it is for."""
    first = found["missing"].split(" (required)")[0]
    name, _, text = first.partition(" ")
    text = re.sub(r"^(?:PATH|STR|INT|FLOAT)(?: \.\.\.)? ", "", text)
    purpose = re.split(r"\.(?: |$)", text)[0]
    word = purpose.partition(" ")[0]
    if word[1:].islower() or len(word) == 1:
        # Words such as CSV and GenTact keep their capitals.
        purpose = word.lower() + purpose[len(word) :]
    return f"{name} is missing: {purpose}"


def describe_choice(found: re.Match[str]) -> str:
    """Describe a word that is none of some."""
    names = re.findall(r"'([^']*)'", found["allowed"])
    if "None" in names:
        # tyro shuffles them, and adds None, where an option may be left out.
        names = sorted(set(names) - {"None"})
    allowed = ", ".join(names)
    return f"{found['option']} is '{found['got']}'; allowed are {allowed}"


def describe_value(found: re.Match[str]) -> str:
    """Describe a value of the wrong type."""
    kind = found["kind"].replace("{None}|", "").strip("{}")
    several = re.fullmatch(r"\[(?P<kind>[A-Z]+) \[\w+ \.\.\.\]\]", kind)
    words = [KINDS.get(word, word) for word in kind.split()]
    allowed = " and ".join(words)
    if len(words) > 1 and len(set(words)) == 1:
        allowed = f"{words[0]} {format_count(len(words), 'time')}"
    if several is not None:
        allowed = f"{KINDS.get(several['kind'], several['kind'])} for each"
    got = " ".join(re.findall(r"'([^']*)'", found["got"]))
    return f"{found['option']} is '{got}'; allowed is {allowed}"


def describe_number(found: re.Match[str]) -> str:
    """Describe a value that is no number."""
    allowed = KINDS["INT" if "int()" in found["kind"] else "FLOAT"]
    return f"{found['option']} is {found['got']}; allowed is {allowed}"


def describe_setting(found: re.Match[str]) -> str:
    """Describe a value that a group of options refuses, by the option's name."""
    name, verb, text = found["text"].partition(" is ")
    if not verb or not name.isidentifier():
        return found["text"]
    return f"--{found['group']}.{name.replace('_', '-')} is {text}"


REWRITTEN: tuple[tuple[str, Callable[[re.Match[str]], str]], ...] = (
    (r"Missing from [^:]*: (?P<missing>.*)", describe_missing),
    (
        r"Missing value for argument '(?P<option>[^']*)'",
        lambda found: f"{found['option']} has no value; give one after it",
    ),
    (
        r"[Ii]nvalid choice '(?P<got>[^']*)' for argument '(?P<option>[^']*)'\. "
        r"Expected one of \((?P<allowed>.*)\)",
        describe_choice,
    ),
    (
        r"Error parsing (?P<option>\S+): no type matching (?P<kind>.*?) could be "
        r"instantiated from \[(?P<got>.*?)\]\.",
        describe_value,
    ),
    (
        r"Error parsing (?P<option>\S+): (?P<kind>invalid literal for int\(\).*?|could "
        r"not convert string to float): (?P<got>'.*?')$",
        describe_number,
    ),
    (
        r"Error parsing (?P<option>--\S+): Failed to parse key-value pairs",
        lambda found: f"{found['option']} is no name and number; give both",
    ),
    (r"Error parsing (?P<group>[a-z]\S*): (?P<text>.*)", describe_setting),
)
"""Patterns of messages of tyro, and the messages instead."""
