"""What concerns the pages: who has one open, what they share."""

from dataclasses import dataclass
from typing import ClassVar, Final

PROTOCOL: Final = 1
"""Of the messages; a page that knows another asks its operator to load it again."""


@dataclass(frozen=True, slots=True)
class Hello:
    """The first message to a page.

    Attributes:
        instance: of the server's process; numbers of messages start anew with each.
        seq: the number of the last message that was sent to all.
        resumed: whether all that the page missed since the number it named follows.
        operator: under which name this page commands.
    """

    ty: ClassVar[str] = "hello"

    protocol: int
    instance: str
    seq: int
    utc: float
    operator: str
    resumed: bool


@dataclass(frozen=True, slots=True)
class OpenPage:
    """A page that is open."""

    console: str
    operator: str
    since: float


@dataclass(frozen=True, slots=True)
class Presence:
    """Which pages are open, at all consoles with the same archive."""

    ty: ClassVar[str] = "presence"

    consoles: tuple[OpenPage, ...]


@dataclass(frozen=True, slots=True)
class DictionaryChanged:
    """The dictionary has something new of an asset: ask for it again."""

    ty: ClassVar[str] = "dictionary"

    asset: str


@dataclass(frozen=True, slots=True)
class ObjectChanged:
    """An operators' object has a new revision; None, it was deleted."""

    ty: ClassVar[str] = "obj"

    key: str
    revision: int | None
