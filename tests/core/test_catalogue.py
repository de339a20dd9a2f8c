"""Every request is declared, once, and everything that is derived from declarations has it."""

from dataclasses import FrozenInstanceError
from typing import get_args

import pytest

from executive.commands import (
    ACCEPTED,
    CameraWork,
    Family,
    InstantCommand,
    Motion,
    MoveForward,
    PlanRequest,
    Request,
    Setting,
    declaration_of,
    declared,
)
from executive.plans import LEAVES
from tests.support.requests import GOOD

UNIONS = {
    Motion: {Family.MOTION},
    CameraWork: {Family.CAMERA},
    InstantCommand: {Family.INSTANT},
    Setting: {Family.SETTING, Family.POSE},
    PlanRequest: {Family.PLAN, Family.PLAN_START},
}


def test_the_union_holds_what_is_declared() -> None:
    assert {each.kind for each in declared()} == set(get_args(Request))


def test_a_family_is_the_union_of_its_queue() -> None:
    for union, families in UNIONS.items():
        kinds = {each.kind for each in declared() if each.family in families}
        assert kinds == set(get_args(union))
    assert set(ACCEPTED) == set(Family)


def test_there_is_a_good_example_of_every_request() -> None:
    assert {type(request) for request in GOOD} == set(get_args(Request))


def test_names_and_operations_are_used_once() -> None:
    for of_each in (lambda each: each.name, lambda each: (each.service, each.operation)):
        found = list(map(of_each, declared()))
        assert len(found) == len(set(found))


def test_what_is_declared_is_told_in_a_sentence() -> None:
    for each in declared():
        assert each.summary.endswith("."), each.name
        assert each.examples or each.family in {Family.INSTANT, Family.PLAN, Family.PLAN_START}


def test_every_goal_is_a_leaf_of_plans() -> None:
    goals = {*get_args(Motion), *get_args(CameraWork), *get_args(InstantCommand)}
    assert {declaration_of(kind).name for kind in goals} <= set(LEAVES)


def test_a_request_cannot_be_changed() -> None:
    with pytest.raises(FrozenInstanceError):
        MoveForward(1.0).distance_m = 2.0  # type: ignore[misc]
