"""Writes the types of what the pages receive: `python -m tests.console.message_types`."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from enum import EnumType
from types import NoneType, UnionType
from typing import Any, Final, Union, get_args, get_origin, get_type_hints

from adapters.console.archive.objects import PlanRevision
from adapters.console.messages import Message
from adapters.console.requests.drafts import PlanDraft, PlanNodeEntry, PlanTemplate
from adapters.console.requests.explaining import ExplanationBody
from adapters.console.requests.files import FileEntry
from adapters.console.requests.map_requests import RouteStep
from adapters.console.requests.plan_checks import DraftCheck
from adapters.console.rovers.dictionary import AssetEntry
from adapters.mrs.spec import Preview
from tests.docs.pages import CHECKOUT

FILE: Final = CHECKOUT / "adapters" / "console" / "static" / "app" / "model" / "messages.d.ts"
ANSWERS: Final = (
    *(AssetEntry, FileEntry, PlanRevision, Preview, ExplanationBody, RouteStep),
    *(PlanDraft, PlanTemplate, PlanNodeEntry, DraftCheck),
)
PLAIN: Final = {Any: "any", NoneType: "null", bool: "boolean", str: "string"} | dict.fromkeys(
    (int, float), "number"
)


def message_types() -> str:
    """Return the types of all messages and of the answers that pages read."""
    found: dict[str, str] = {}
    for kind in (*get_args(Message), *ANSWERS):
        _written(kind, found)
    messages = " | ".join(each.__name__ for each in get_args(Message))
    return "\n".join(
        (
            "/** What the server sends; written by `python -m tests.console.message_types`. */\n",
            *found.values(),
            f"export type Message = ({messages}) & {{ seq?: number }};\n",
        )
    )


def _written(kind: Any, found: dict[str, str]) -> str:
    """Return a type as TypeScript has it, after those of the dataclasses in it are found."""
    if kind in PLAIN:
        return PLAIN[kind]
    if isinstance(kind, EnumType):
        members: list[Any] = list(kind)
        return _named(kind, found, lambda: " | ".join(f'"{each.value}"' for each in members))
    if is_dataclass(kind):
        return _named(kind, found, lambda: _fields(kind, found))
    parts = [_written(each, found) for each in get_args(kind) if each is not Ellipsis]
    match get_origin(kind):
        case origin if origin in {Union, UnionType}:
            return " | ".join(dict.fromkeys(parts))
        case origin if origin is dict:
            return f"Record<{', '.join(parts)}>"
        case origin if origin is tuple and Ellipsis in get_args(kind):
            return f"{parts[0]}[]"
        case origin if origin is tuple:
            return f"[{', '.join(parts)}]"
    raise TypeError(f"{kind} is no type of a message")


def _named(kind: Any, found: dict[str, str], write: Callable[[], str]) -> str:
    name: str = kind.__name__
    if name not in found:
        found[name] = ""  # it may be among its own fields
        body = write()
        del found[name]
        found[name] = f"/** {kind.__doc__.splitlines()[0]} */ export type {name} = {body};"
    return name


def _fields(kind: Any, found: dict[str, str]) -> str:
    hints = get_type_hints(kind)
    parts = [f'ty: "{kind.ty}"'] if hasattr(kind, "ty") else []
    parts += [f"{each.name}: {_written(hints[each.name], found)}" for each in fields(kind)]
    return f"{{ {'; '.join(parts)} }}"


if __name__ == "__main__":
    FILE.write_text(message_types(), encoding="utf-8")
