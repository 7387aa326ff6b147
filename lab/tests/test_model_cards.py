"""Tests of the pages of weights: they agree with the files and with one another."""

import pytest
import yaml

from eskin.live import MODELS, load_model
from lab.build import ROOT
from lab.model_cards import describe


@pytest.mark.parametrize("name", MODELS)
def test_page_states_what_the_file_holds(name):
    text = describe(name)
    card = load_model(name).card
    assert text.startswith(f"# Weights {name}\n")
    assert card.data_digest in text and ", ".join(card.vocabulary) in text
    for value in (*card.metrics.values(), card.temperature):
        assert f"{value:.3f}" in text
    for key, value in card.training.items():
        assert f"| {key} | {value} |" in text
    for part in ("Apache-2.0", "safety", "results", "people", "lab.curve"):
        assert part in text


def test_navigation_has_a_page_for_every_weight():
    text = (ROOT / "mkdocs.yml").read_text()
    groups = [next(iter(group.values())) for group in yaml.safe_load(text)["nav"][1:]]
    entries = [entry for group in groups for entry in group if isinstance(entry, dict)]
    [models] = [entry["Models"] for entry in entries if "Models" in entry]
    assert models == [{name: f"models/{name}.md"} for name in MODELS]
