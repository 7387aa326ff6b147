"""This module reads message definitions: their fields, and their hashes in ROS 2."""

import hashlib
import json
import re
from dataclasses import dataclass

from eskin.recording.messages import Topic

RULE = re.compile(r"^=+\nMSG: (\S+)\n", re.MULTILINE)
FIELD = re.compile(r"^(\S+?)(\[\])? (\w+)$")
FIELD_TYPE_IDS = {
    "int8": 2,
    "uint8": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": 17,
}
"""Numbers of the basic types in `type_description_interfaces/msg/FieldType`."""
NESTED_TYPE_ID = 1
SEQUENCE_OFFSET = 144
"""What is added to the number of a type for an unbounded sequence of it."""


@dataclass(frozen=True)
class MessageField:
    """A field of a message has a name and a type, and may be a sequence of it."""

    name: str
    type_name: str
    """Basic type such as `float64`, or full name such as `std_msgs/msg/Header`."""
    is_sequence: bool
    """Whether it holds any number of values."""

    @property
    def is_nested(self) -> bool:
        """Return whether its type is a message."""
        return self.type_name not in FIELD_TYPE_IDS


Fields = tuple[MessageField, ...]


def parse_definition(topic: Topic) -> dict[str, Fields]:
    """Return the fields of a topic's type, and of all types in it, by full name.

    The topic's own type comes first.
    """
    own, *others = RULE.split(topic.definition)
    names = [topic.type_name, *map(expand_name, others[::2])]
    texts = [own, *others[1::2]]
    return {name: parse_fields(text) for name, text in zip(names, texts, strict=True)}


def expand_name(name: str) -> str:
    """Return `package/msg/Type` for the `package/Type` of a definition."""
    return name if name in FIELD_TYPE_IDS else "/msg/".join(name.split("/"))


def parse_fields(text: str) -> Fields:
    """Return the fields of one definition, without its comments."""
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    found = []
    for line in lines:
        match = FIELD.match(line)
        assert match is not None, line
        kind, sequence, name = match.groups()
        found.append(MessageField(name, expand_name(kind), bool(sequence)))
    return tuple(found)


def compute_type_hash(topic: Topic) -> str:
    """Return the hash of a topic's type as ROS 2 Iron and later state it.

    It is the SHA-256 of the type's description in JSON (REP 2016).
    """
    definitions = parse_definition(topic)
    own, *others = [
        {"type_name": name, "fields": list(map(describe_field, fields))}
        for name, fields in definitions.items()
    ]
    others.sort(key=lambda description: str(description["type_name"]))
    whole = {"type_description": own, "referenced_type_descriptions": others}
    return "RIHS01_" + hashlib.sha256(json.dumps(whole).encode()).hexdigest()


def describe_field(field: MessageField) -> dict[str, object]:
    """Return the description of a field, in the order of keys that is hashed."""
    number = FIELD_TYPE_IDS.get(field.type_name, NESTED_TYPE_ID)
    return {
        "name": field.name,
        "type": {
            "type_id": number + SEQUENCE_OFFSET * field.is_sequence,
            "capacity": 0,
            "string_capacity": 0,
            "nested_type_name": field.type_name if field.is_nested else "",
        },
    }
