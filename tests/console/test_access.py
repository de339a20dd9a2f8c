"""Who may speak to a console, and how what makes no sense is answered."""

import asyncio
import socket
import ssl
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from aiohttp import ClientSession, TCPConnector, WSCloseCode

from adapters.console.web import read_tokens
from adapters.mrs.terms import Terms
from adapters.process import StartError
from tests.console.conftest import NEEDED, Launch
from tests.console.consoles import at_console, operator, served
from tests.support.certificates import certified

NOBODY = "127.0.0.1:1"
TOKENS = "# who may log in\nanna 0123456789abcdef\nBen the second fedcba9876543210\n"


@contextmanager
def refused(said: str) -> Iterator[None]:
    with pytest.raises(StartError) as raised:
        yield
    assert said in str(raised.value)


async def test_a_page_of_another_site_may_neither_post_nor_listen(tmp_path: Path) -> None:
    foreign = {"Origin": "http://evil.example"}
    async with served(tmp_path, NOBODY) as address, operator(address, "anna") as anna:
        own = {"Origin": address.rstrip("/")}
        assert (await anna.ask("GET", "api/dictionary", headers=own))[0] == 200
        for method, path in (("GET", "api/dictionary"), ("POST", "api/stop/jackal"), ("GET", "ws")):
            status, answer = await anna.ask(method, path, headers=foreign)
            assert (status, "may not ask here" in answer.get("error", "may not ask here")) == (
                403,
                True,
            )
        rebound = {"Host": "evil.example"}
        assert (await anna.ask("GET", "api/dictionary", headers=rebound))[0] == 403
        async with ClientSession() as without, without.post(f"{address}api/stop/jackal") as said:
            assert said.status == 403
            assert "X-Rover-Operator is needed" in (await said.json())["error"]


async def test_answers_keep_browsers_from_loading_or_framing_anything_else(tmp_path: Path) -> None:
    async with (
        served(tmp_path, NOBODY) as address,
        ClientSession() as browser,
        browser.get(address) as page,
    ):
        assert "default-src 'self'" in page.headers["Content-Security-Policy"]
        assert page.headers["X-Content-Type-Options"] == "nosniff"


BAD: list[tuple[dict[str, Any], str, tuple[Any, Any]]] = [
    ({"name": "moveForward", "args": {"distance": 1000}}, "distance", (-100.0, 100.0)),
    ({"name": "moveForward", "args": {"distance": "1"}}, "distance", (-100.0, 100.0)),
    ({"name": "moveForward", "args": {"distance": True}}, "distance", (-100.0, 100.0)),
    ({"name": "moveForward", "args": {}}, "distance", (None, None)),
    ({"name": "moveForward", "args": {"distance": 1, "speed": 1}}, "speed", (None, None)),
    ({"name": "moveForward", "args": [1]}, "", (None, None)),
    ({"name": "moveForward", "arrival": "later", "args": {"distance": 1}}, "arrival", (None, None)),
    ({"name": "moveTo", "args": {"x": 1, "y": 1, "controller": "pid"}}, "controller", (None, None)),
    ({"name": "followPath", "args": {"waypoints": []}}, "waypoints", (1, 100)),
    ({"name": "followPath", "args": {"waypoints": [{"x": 0, "y": 0, "heading": 7}]}},
     "waypoints[0].heading", (pytest.approx(-6.2832, abs=1e-4), pytest.approx(6.2832, abs=1e-4))),
    ({"name": "setCameraAngles", "args": {}}, "pan", (None, None)),
    ({"name": "takePicture", "args": {"width": 641}}, "width", (640, 640)),
    ({"name": "takePicture", "args": {"width": 640.5}}, "width", (640, 640)),
    ({"name": "fly", "args": {}}, "name", (None, None)),
    ({"name": "submitPlan", "args": {}}, "name", (None, None)),
    ({"name": "resume", "lifetime": -1}, "lifetime", (0.0, 604800.0)),
    ({"name": "resume", "id": ""}, "id", (None, None)),
    ({"name": "resume", "link": "pigeon"}, "link", (None, None)),
]  # fmt: skip


async def test_bad_arguments_are_named_with_their_range(launch: Launch, tmp_path: Path) -> None:
    async with at_console(tmp_path, launch().uri, "anna") as (anna,):
        await anna.page.is_up()
        for number, (body, field, bounds) in enumerate(BAD):
            posted = {"id": f"bad{number}", "asset": "jackal"} | body
            status, answer = await anna.post("api/commands", **posted)
            assert (status, answer.get("field")) == (422, field), (body, answer)
            assert (answer.get("low"), answer.get("high")) == bounds, answer
            assert answer["error"]
        unknown = await anna.send("there", "resume", "no such rover")
        assert (unknown[0], "there are: jackal" in unknown[1]["error"]) == (404, True)
        found = await anna.get("api/commands")
        assert found["commands"] == []


async def test_requests_that_make_no_sense_are_answered_by_what_to_do(tmp_path: Path) -> None:
    async with served(tmp_path, NOBODY) as address, operator(address, "anna") as anna:

        async def status(method: str, path: str, **request: Any) -> int:
            code, answer = await anna.ask(method, path, **request)
            assert answer["error"]
            return code

        assert await status("POST", "api/commands", data=b"\xff{") == 400
        assert await status("POST", "api/commands", data=b"[" * 100_000) == 400
        assert await status("POST", "api/commands", data=BytesIO(b"1" * 2_000_000)) == 413
        assert await status("GET", "api/nothing") == 404
        assert await status("GET", "api/tm/jackal/POS_X?size=0") == 422
        assert await status("GET", "api/tm/jackal/POS_X?start=nan") == 422
        assert await status("GET", "api/tm/jackal/POS_X?strategy=all") == 422
        assert await status("GET", "api/notifications?limit=100000") == 422
        assert await status("POST", "api/tm:batch", json={"keys": [["jackal"]]}) == 422
        assert await status("POST", "api/authority/jackal", json={"act": "grab"}) == 422
        assert await status("POST", "api/authority/jackal", json={"act": "hand_over"}) == 422
        assert await status("POST", "api/authority/jackal", json={"act": "request"}) == 404
        assert await status("GET", "api/objects/none") == 404
        assert await status("PUT", "api/objects/none", json={"value": 1}) == 428
        assert await status("GET", "api/export?fmt=xls") == 422
        bad_name = {"X-Rover-Operator": "plan%3Ax"}
        assert await status("POST", "api/stop/jackal", headers=bad_name) == 422


async def test_objects_are_shared_by_revision(tmp_path: Path) -> None:
    async with at_console(tmp_path, NOBODY, "anna", "ben") as (anna, ben):
        new = {"If-None-Match": "*"}
        first = await anna.ask("PUT", "api/objects/plot", json={"value": [1]}, headers=new)
        assert first == (200, {"key": "plot", "revision": 1})
        await ben.page.until(lambda said: (said["ty"], said.get("revision")) == ("obj", 1))
        match = {"If-Match": '"1"'}
        changed = await ben.ask("PUT", "api/objects/plot", json={"value": [2]}, headers=match)
        assert changed[1]["revision"] == 2
        late = await anna.ask("PUT", "api/objects/plot", json={"value": [3]}, headers=match)
        assert (late[0], late[1]["revision"]) == (412, 2)
        found = await anna.get("api/objects/plot")
        assert (found["value"], found["operator"]) == ([2], "ben")
        assert (await anna.get("api/objects"))["objects"] == [{"key": "plot", "revision": 2}]
        gone = await anna.ask("DELETE", "api/objects/plot", headers={"If-Match": '"2"'})
        assert gone[0] == 204


async def test_what_a_page_says_wrongly_closes_its_socket_with_the_reason(tmp_path: Path) -> None:
    async with served(tmp_path, NOBODY) as address, ClientSession() as browser:
        for said in (
            '{"op": "sub"}',
            "[]",
            "{",
            '{"op": "hello"}',
            '{"op": "hello", "console": 1}',
        ):
            async with browser.ws_connect(f"{address}ws") as page:
                await page.send_str(said)
                await page.receive()
                assert page.close_code == WSCloseCode.POLICY_VIOLATION


async def test_with_tokens_only_who_has_one_gets_in_under_its_name(tmp_path: Path) -> None:
    tokens = tmp_path / "tokens"
    tokens.write_text(TOKENS)
    ends = certified(tmp_path, "console")["console"]
    tls = (ends.certificate, ends.key)
    trusted = ssl.create_default_context(cafile=ends.authorities)
    async with served(tmp_path, NOBODY, host="0.0.0.0", tokens=tokens, tls=tls) as address:
        there = address.replace("0.0.0.0", "127.0.0.1")
        connector = TCPConnector(ssl=trusted)
        async with ClientSession(connector=connector, headers={"X-Rover-Operator": "x"}) as browser:
            async with browser.get(f"{there}api/dictionary") as answer:
                assert answer.status == 401
            async with browser.post(f"{there}api/login", json={"token": "no"}) as answer:
                assert answer.status == 401
            bearer = {"Authorization": "Bearer 0123456789abcdef"}
            async with browser.get(f"{there}api/dictionary", headers=bearer) as answer:
                assert answer.status == 200
            token = {"token": "fedcba9876543210"}
            async with browser.post(f"{there}api/login", json=token) as answer:
                assert (await answer.json())["operator"] == "Ben the second"
                cookie = answer.headers["Set-Cookie"]
                assert all(part in cookie for part in ("HttpOnly", "Secure", "SameSite=Strict"))
            kept = {"Cookie": cookie.partition(";")[0]}
            async with browser.ws_connect(f"{there}ws", headers=kept) as page:
                await page.send_json({"op": "hello", "console": "A", "operator": "anna"})
                assert (await page.receive_json())[0]["operator"] == "Ben the second"


async def test_where_others_reach_it_the_start_says_what_is_needed(tmp_path: Path) -> None:
    with refused("--tokens FILE (lines NAME TOKEN), and serve HTTPS with --tls-certificate"):
        async with served(tmp_path, NOBODY, host="0.0.0.0"):
            pass
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with refused("give another with --port"):
            async with served(tmp_path, NOBODY, port=taken.getsockname()[1]):
                pass
    async with served(tmp_path, NOBODY):
        with refused("another process"):
            async with served(tmp_path, NOBODY):
                pass


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "has no line NAME TOKEN"),
        ("anna short", "line 1: write NAME TOKEN"),
        ("0123456789abcdef", "line 1: write NAME TOKEN"),
        ("plan:x 0123456789abcdef", "line 1: write NAME TOKEN"),
        ("anna 0123456789abcdef\nben 0123456789abcdef", "line 2: this token is another's, too"),
    ],
)
def test_a_file_of_tokens_that_makes_no_sense_is_told(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "tokens").write_text(text)
    with refused(said):
        read_tokens(tmp_path / "tokens")


async def test_with_one_certificate_operators_take_turns(tmp_path: Path, launch: Launch) -> None:
    ends = certified(tmp_path, "rover", "MCC")
    rover = launch(terms=Terms(certificates=ends["rover"]), authority=NEEDED)
    rover.runs = True
    terms = Terms(certificates=ends["MCC"])
    async with at_console(tmp_path, rover.uri, "anna", "ben", terms=terms) as (anna, ben):
        await anna.page.is_up()
        status, held = await anna.authority("request")
        assert (status, held["holder"], held["operator"]) == (200, "MCC", "anna")
        assert (await anna.send("a", "moveForward", distance=0.5))[1]["source"] == "MCC"
        await ben.page.command("a", "executed")
        assert (await ben.send("b", "moveForward", distance=0.5))[0] == 403
        status, refusal = await ben.authority("request")
        assert (status, refusal["holder"]) == (403, "anna")
        await anna.page.until(lambda said: said.get("asked_by") == "ben")
        assert (await anna.authority("hand_over", to="ben"))[1]["operator"] == "ben"
        assert (await anna.send("c", "moveForward", distance=0.5))[0] == 403
        assert (await ben.send("d", "moveForward", distance=0.5))[0] == 202
        await anna.page.command("d", "executed")
        assert (await anna.ask("POST", "api/stop/jackal"))[0] == 202
        await ben.page.until(lambda said: said.get("mode") == "STOPPED")


async def test_a_page_that_has_not_changed_is_answered_without_a_body(tmp_path: Path) -> None:
    """What came after the head would be taken for the next answer of the connection."""
    async with served(tmp_path, NOBODY) as address, operator(address, "anna") as anna:
        async with anna.session.get(f"{address}app/views/files.js") as first:
            assert first.headers["Content-Encoding"] == "deflate"
            tag = first.headers["ETag"]
        host = urlsplit(address).netloc
        reader, writer = await asyncio.open_connection(*host.split(":"))
        head = f"GET /app/views/files.js HTTP/1.1\r\nHost: {host}\r\nAccept-Encoding: deflate\r\n"
        writer.write(f"{head}If-None-Match: {tag}\r\nConnection: close\r\n\r\n".encode())
        said, _, body = (await reader.read()).partition(b"\r\n\r\n")
        writer.close()
        await writer.wait_closed()
        assert (said.split(b"\r\n")[0], body) == (b"HTTP/1.1 304 Not Modified", b"")
