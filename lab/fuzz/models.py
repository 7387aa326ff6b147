"""Fuzz the reader of models, and the compiled code that uses the numbers of a card."""

import json
import random
import struct
from pathlib import Path
from typing import Any, final

import numpy as np
from pydantic_core import to_jsonable_python
from safetensors.numpy import save

from eskin.errors import ModelError
from eskin.live import (
    ModelCard,
    NetworkConfig,
    Recognizer,
    load_model,
)
from eskin.live.model_file import CARD, network_shapes
from eskin.robot import load_robot
from eskin.skin import MountedSkin
from eskin.touch import Calibration, Scan
from lab.fuzz.mutation import mutate
from lab.fuzz.run import Target, check_refusal
from lab.fuzz.skin_files import small_skin

LENGTH = struct.Struct("<Q")
"""Length of the header, at the start of a file."""
NUMBERS = (
    0,
    1,
    -1,
    2,
    0.5,
    1e-300,
    1e3,
    1e6,
    1e12,
    1e300,
    -1e300,
    2**31,
    2**63,
    2**80,
    "NaN",
    "Infinity",
    "-Infinity",
    None,
    "",
    [],
    {},
    True,
    "a\nb",
    "9" * 400,
)
"""Values that take the place of others in a card."""
WORDS = (b"[", b"{}", b"null", b"NaN", b"1e999", b'"', b"[" * 2000, b"F64", b"I8")
SCANS = 40
"""Number of scans that a model is given, enough for the tare and a touch."""
PERIOD = 40_000_000


@final
class ModelTarget(Target):
    """Fuzzes the reader of models; a model that is read must recognise a touch."""

    def __init__(self, folder: Path) -> None:
        """Start from the smallest model; the inputs are written into the folder."""
        self.path = folder / "model.safetensors"
        network = NetworkConfig(width=1, layers=1, channels=1)
        card = ModelCard(("none", "poke"), network=network)
        self.card = to_jsonable_python(card, inf_nan_mode="strings")
        shapes = network_shapes(card)
        self.weights = {name: np.zeros(shapes[name], np.float32) for name in shapes}
        self.whole = self.encode(self.card)
        skin = small_skin()
        self.mounted = MountedSkin(skin, load_robot("table"))
        self.calibration = Calibration.uniform(skin.count, 4095, 100.0)
        # Code is compiled before the time of an input is measured.
        assert self.feed(self.whole)

    def encode(self, card: object) -> bytes:
        """Encode the weights with a card."""
        return save(self.weights, {CARD: json.dumps(card)})

    def make(self, rng: random.Random) -> bytes:
        """Return the file with values of its card replaced, or with its bytes mutated.

        The length of the header is corrected now and then.
        """
        change = rng.random()
        if change < 0.7:
            card = json.loads(json.dumps(self.card))
            for _ in range(rng.choice((1, 1, 2, 3))):
                replace_value(card, rng)
            return self.encode(card)
        if change < 0.85:
            return mutate(self.whole, rng, WORDS)
        (length,) = LENGTH.unpack_from(self.whole)
        end = LENGTH.size + length
        header = mutate(self.whole[LENGTH.size : end], rng, WORDS)
        return LENGTH.pack(len(header)) + header + self.whole[end:]

    def feed(self, data: bytes) -> bool:
        """Load the model and give it scans of a press."""
        self.path.write_bytes(data)
        try:
            model = load_model(self.path)
        except ModelError as error:
            check_refusal(error)
            return False
        card = model.card
        has_unknown = bool(set(card.decision.thresholds) - set(card.vocabulary))
        try:
            recognizer = Recognizer(model, self.mounted, self.calibration)
        except ModelError as error:
            check_refusal(error)
            return False
        except ValueError:
            if not has_unknown:
                raise
            return False
        count = self.mounted.skin.count
        received = np.ones(count, np.bool_)
        for number in range(SCANS):
            counts = np.full(count, 20 + number % 2, np.int32)
            counts[:9] += 900 * (number > SCANS // 2)
            recognizer.push(Scan(number * PERIOD, counts, received, np.empty(0)))
        recognizer.finish()
        return True


def replace_value(card: dict[str, Any], rng: random.Random) -> None:
    """Replace a value of a card, at any depth."""
    key = rng.choice(list(card))
    if isinstance(card[key], dict) and card[key] and rng.random() < 0.9:
        replace_value(card[key], rng)
    else:
        card[key] = rng.choice(NUMBERS)
