"""What to try from a second terminal with rovers that stay."""

import asyncio
from collections.abc import Iterator
from typing import Final

from sim.demo.cast import Cast, Role

DEFAULT: Final = "jackal"


def proposals(cast: Cast) -> str:
    """Return commands to try, with a heading."""
    lines = ["", "The rovers stay." if len(cast.roles) > 1 else "The rover stays."]
    lines[-1] += " From a second terminal, in this folder:"
    for role in cast.roles:
        lines += ["", *(f"  ./rover {words}" for words in _proposed(role, cast))]
    return "\n".join([*lines, ""])


def _proposed(role: Role, cast: Cast) -> Iterator[str]:
    asset = role.script.asset
    first = role is cast.roles[0]
    there = "" if first else f" --to 127.0.0.1:{role.rover.place.port}"
    yield f"command{there} moveTo 3 2 --heading 90deg"
    yield f"command{there} stop"
    yield f"command{there} resume"
    yield f"status{there}"
    yield "watch" if asset == DEFAULT else f"watch --asset {asset}"
    if cast.orbiter is not None:
        relay = asyncio.run(cast.orbiter.uri(asset)).removeprefix("maltcp://").removesuffix("/MRS")
        yield f"command --to {relay} moveForward -0.5"
        yield f"status --to {relay}"
