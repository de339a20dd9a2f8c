"""What came in, one after the other, for one listener."""

import asyncio
from typing import Generic, TypeVar

T = TypeVar("T")


class Stream(Generic[T]):
    """An asynchronous iterator over what is put; it ends when closed, or raises when failed."""

    def __init__(self) -> None:
        """Start empty."""
        self._items: asyncio.Queue[T | None] = asyncio.Queue()
        self._fault: Exception | None = None
        self.closed = False

    def put(self, item: T) -> None:
        """Add an item; none is taken once closed."""
        if not self.closed:
            self._items.put_nowait(item)

    def close(self, fault: Exception | None = None) -> None:
        """End after what was put; with a fault, raise it there."""
        if not self.closed:
            self.closed = True
            self._fault = fault
            self._items.put_nowait(None)

    def __aiter__(self) -> "Stream[T]":
        return self

    async def __anext__(self) -> T:
        item = await self._items.get()
        if item is not None:
            return item
        self._items.put_nowait(None)
        raise self._fault or StopAsyncIteration
