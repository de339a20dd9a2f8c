"""Random commands, all that the catalogue declares: each depends on seed and number alone."""

from math import inf, nan
from random import Random
from typing import Any, Final

from executive.commands import (
    Argument,
    Command,
    Family,
    PlanDefinition,
    PreemptionPolicy,
    Request,
    SubmitPlan,
    ValueRange,
    all_declarations,
    arguments_of,
)
from executive.values.reports import Identity

SOURCE: Final = "KILLS"
SMALL_FILES: Final = 1000
"""Small files aboard, to be moved and deleted."""
PER_PLAN: Final = 25
"""Commands in a row that, if they are about a plan, are about the same one."""
ODD: Final = (nan, inf, -0.0, 1e9)
FAMILIES: Final = {each: [d for d in all_declarations() if d.family is each] for each in Family}
WEIGHTS: Final = {Family.MOTION: 8, Family.CAMERA: 2, Family.PLAN: 2, Family.PLAN_START: 2,
                  Family.RESUME: 2}  # fmt: skip
"""How often a family comes, where not once."""
LEAST, MAXIMUM = 0.2, 1.5
"""Of figures that may not be negative."""
PLAN: Final = b"""\
<root BTCPP_format="4">
  <BehaviorTree ID="Look">
    <Sequence>
      <moveForward distance="0.2" deadline_s="10"/>
      <takePicture deadline_s="10"/>
      <rotateBy angle="0.4" deadline_s="10"/>
    </Sequence>
  </BehaviorTree>
</root>
"""


def small_file(number: int) -> str:
    return f"errands/{number % SMALL_FILES}.txt"


def random_command(seed: int, number: int, link: str, utc_s: float) -> Command:
    """Return the command that has this number, made at a time for a link."""
    random = Random(f"{seed} {number}")
    return Command(
        identity=Identity(SOURCE, number),
        request=random_request(random, number),
        link=link,
        created_utc_s=utc_s,
        lifetime_s=random.choice((None, None, None, random.uniform(1.0, 10.0))),
        preemption=random.choice(
            (PreemptionPolicy.APPEND, PreemptionPolicy.REPLACE, PreemptionPolicy.REPLACE)
        ),
    )


def random_request(random: Random, number: int, odd: float = 0.0) -> Request:
    """Return a request of any kind.

    Args:
        random: decides.
        number: of the command: what it has of files and plans, others have had.
        odd: part of the figures that make no sense.
    """
    plan_id = f"plan-{number // PER_PLAN}"
    moved = f"moved/{random.randrange(max(number, 1)) % SMALL_FILES}.txt"
    texts = {
        "plan_id": (plan_id,),
        "path": (small_file(number), moved),
        "target": (f"moved/{number % SMALL_FILES}.txt",),
        "action": ("VIDEO ON", "VIDEO OFF"),
    }

    def made(kind: type[Any], arguments: tuple[Argument, ...]) -> Any:
        return kind(**{each.field: value(each) for each in arguments})

    def value(argument: Argument) -> Any:
        if argument.repeated:
            return tuple(one(argument) for _ in range(random.randrange(4)))
        # What a picture is to be like, assets rarely choose.
        left_out = argument.optional and (argument.choices or random.random() < 0.5)
        return None if left_out else one(argument)

    def one(argument: Argument) -> Any:
        if parts := arguments_of(argument.kind):
            return made(argument.kind, parts)
        if argument.kind is PlanDefinition:
            return PlanDefinition(plan_id, "look", "BTCPP4", PLAN)
        if argument.kind is str:
            return random.choice(texts.get(argument.field, ("near",)))
        return figure(argument.bound)

    def figure(bound: object) -> float:
        if random.random() < odd:
            return random.choice(ODD)
        positive = isinstance(bound, ValueRange) and isinstance(bound.low, float)
        return random.uniform(LEAST, MAXIMUM) if positive else random.uniform(-1.0, 1.0)

    if number % PER_PLAN == 1:
        return SubmitPlan(PlanDefinition(plan_id, "look", "BTCPP4", PLAN))
    weights = [WEIGHTS.get(family, 1) for family in FAMILIES]
    (family,) = random.choices(list(FAMILIES), weights)
    declaration = random.choice(FAMILIES[family])
    request: Request = made(declaration.kind, declaration.arguments)
    return request
