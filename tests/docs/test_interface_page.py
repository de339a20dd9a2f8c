"""The interface page is as it is written from the specification, and its examples are true."""

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from adapters.mal import Codec, Encoding, Operation, Service, values
from adapters.mal.codec import decode_message
from adapters.mrs.spec import mrs_specification, types
from tests.docs.interface_page import (
    COMMAND_HEADER,
    interface_page,
    messages,
    octet_dump,
    stop_message,
)

PAGE = (Path(__file__).parents[2] / "docs" / "mrs.md").read_text(encoding="utf-8")
SPECIFICATION = mrs_specification()
(AREA,) = (area for area in SPECIFICATION.areas if area.name == "MRS")
OPERATIONS = [operation for service in AREA.services for operation in service.operations]


class Recorder:
    """A consumer that answers with the example's answer and keeps what was asked of it."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, str, tuple[Any, ...]]] = []

    async def submit(self, service: str, operation: str, *parts: Any) -> None:
        self.calls.append((service, operation, parts))

    async def request(self, service: str, operation: str, *parts: Any) -> tuple[Any, ...]:
        self.calls.append((service, operation, parts))
        _, answer = messages(SPECIFICATION.operation(service, operation))
        return answer.values

    async def subscribe(
        self, service: str, operation: str, subscription: Any, on_update: Any
    ) -> None:
        assert on_update is print
        self.calls.append((service, operation, (subscription,)))

    @asynccontextmanager
    async def progress(
        self, service: str, operation: str, *parts: Any
    ) -> AsyncIterator[SimpleNamespace]:
        self.calls.append((service, operation, parts))
        _, acknowledgement, _, _ = messages(SPECIFICATION.operation(service, operation))
        yield SimpleNamespace(acknowledgement=acknowledgement.values)


def examples(service: Service) -> str:
    section = PAGE.split(f"\n## {service.number} {service.name}\n")[1].split("\n## ")[0]
    (block,) = re.findall(r"^```python\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)
    return str(block)


def run(block: str) -> Recorder:
    consumer = Recorder()
    names = {**vars(values), **vars(types)}
    names |= {"consumer": consumer, "command": COMMAND_HEADER, "on_update": print}
    body = "\n".join(f"    {line}" for line in block.splitlines())
    exec(f"async def session():\n{body}", names)
    asyncio.run(names["session"]())
    return consumer


@pytest.mark.parametrize("service", AREA.services, ids=lambda service: service.name)
def test_the_python_of_the_page_makes_the_octets_of_the_page(service: Service) -> None:
    block = examples(service)
    octets = re.findall(r"^# [A-Z_]+ +(.*(?:\n# {19,}.*)*)", block, re.MULTILINE)
    codec, written = Codec(SPECIFICATION), iter(octets)
    calls = iter(run(block).calls)
    for operation in service.operations:
        first, *rest = messages(operation)
        assert next(calls) == (service.name, operation.name, first.values)
        for example in (first, *rest):
            text = re.sub(r"[#\s]|no octets", "", next(written))
            assert example.octets(codec).hex() == text, (operation.name, example.stage)
    assert next(calls, None) is next(written, None) is None


@pytest.mark.parametrize("encoding", Encoding)
@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda o: f"{o.service_name}.{o.name}")
def test_every_example_survives_the_round_trip(operation: Operation, encoding: Encoding) -> None:
    codec = Codec(SPECIFICATION, encoding)
    for example in messages(operation):
        assert codec.decode(example.parts, example.octets(codec)) == example.values


def test_the_message_of_the_page_is_whole() -> None:
    assert "".join(octets for _, octets, _ in octet_dump()) == stop_message().hex()
    header, body = decode_message(stop_message())
    operation = SPECIFICATION.operation("MotionControl", "stop")
    assert (header.service, header.operation) == (operation.service, operation.number)
    assert Codec(SPECIFICATION).decode(operation.parts[header.stage], body) == (COMMAND_HEADER,)
    for _, octets, meaning in octet_dump():
        assert f"| {octets} | {meaning} |" in PAGE


def test_the_page_is_written_from_the_specification() -> None:
    assert interface_page() + "\n" == PAGE, "python -m tests.docs.interface_page > docs/mrs.md"
