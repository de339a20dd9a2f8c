"""The page of faults is as it is written from their declarations, and its example is read."""

from dataclasses import replace

import yaml

from executive.faults import FaultTable, Reaction
from executive.settings import load_settings, structure
from tests.docs.faults_page import PAGE, faults_page
from tests.docs.pages import blocks


def test_the_page_is_written_from_the_declarations() -> None:
    assert PAGE.read_text(encoding="utf-8") == faults_page()


def test_its_example_is_a_valid_file() -> None:
    (example,) = blocks(PAGE, "yaml")
    table = structure(yaml.safe_load(example)["faults"], FaultTable, "the page")
    assert table.uncommanded_turn.reaction is Reaction.IGNORE
    assert replace(load_settings("jackal"), faults=table).faults.odometry_stale.bound == 0.5
