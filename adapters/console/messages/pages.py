"""Messages to the console's pages on the pages themselves: presence, and data that they share."""

from dataclasses import dataclass
from typing import ClassVar, Final

PROTOCOL: Final = 1
"""Version of the messages; a page with another version prompts its operator to reload."""


@dataclass(frozen=True, slots=True)
class Hello:
    """The first message to a page.

    Attributes:
        instance: id of the server's process start; message numbers restart with each.
        seq: number of the last message that was sent to all pages.
        resumed: whether the missed messages since the requested number follow.
        operator: name of the page's operator.
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
    """An open page."""

    console: str
    operator: str
    since: float


@dataclass(frozen=True, slots=True)
class Presence:
    """The open pages of all consoles with the same archive."""

    ty: ClassVar[str] = "presence"

    consoles: tuple[OpenPage, ...]


@dataclass(frozen=True, slots=True)
class DictionaryChanged:
    """The dictionary entry of an asset has changed: request the dictionary again."""

    ty: ClassVar[str] = "dictionary"

    asset: str


@dataclass(frozen=True, slots=True)
class ObjectChanged:
    """A stored object has a new revision; None if it was deleted."""

    ty: ClassVar[str] = "obj"

    key: str
    revision: int | None
