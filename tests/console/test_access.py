"""Who may speak to a console, and how what makes no sense is answered."""

import asyncio
import socket
import ssl
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import pytest
from aiohttp import ClientSession, TCPConnector, WSCloseCode

from adapters.console.requests import SharedObjectRequests
from adapters.console.web import access, read_tokens
from adapters.console.web.access import GUESS_S, MAX_PEERS, MAX_WAIT_S, TokenGuesses
from adapters.mrs.transport import TransportSettings
from adapters.process import StartError
from tests.console.conftest import NEEDED, Launch
from tests.console.consoles import at_console, operator, served
from tests.support.certificates import certified

UNREACHABLE = "127.0.0.1:1"
IF_NEW = {"If-None-Match": "*"}
TOKENS = "# who may log in\nanna 0123456789abcdef\nBen the second fedcba9876543210\n"


@contextmanager
def refused(message: str) -> Iterator[None]:
    with pytest.raises(StartError) as raised:
        yield
    assert message in str(raised.value)


async def test_a_page_of_another_site_may_neither_post_nor_listen(tmp_path: Path) -> None:
    foreign = {"Origin": "http://evil.example"}
    async with served(tmp_path, UNREACHABLE) as address, operator(address, "anna") as anna:
        own = {"Origin": address.rstrip("/")}
        assert (await anna.request("GET", "api/dictionary", headers=own))[0] == 200
        for method, path in (("GET", "api/dictionary"), ("POST", "api/stop/jackal"), ("GET", "ws")):
            status, answer = await anna.request(method, path, headers=foreign)
            why = "requests of pages of http://evil.example are refused"
            assert (status, answer.get("error", why)) == (403, why)
        rebound = {"Host": "evil.example"}
        assert (await anna.request("GET", "api/dictionary", headers=rebound))[0] == 403
        async with ClientSession() as without, without.post(f"{address}api/stop/jackal") as message:
            assert message.status == 403
            assert "X-Rover-Operator is needed" in (await message.json())["error"]


async def test_response_headers_block_foreign_content_and_framing(tmp_path: Path) -> None:
    async with (
        served(tmp_path, UNREACHABLE) as address,
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
    (
        {"name": "moveForward", "preemption": "later", "args": {"distance": 1}},
        "preemption",
        (None, None),
    ),
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
        assert (unknown[0], "known assets: jackal" in unknown[1]["error"]) == (404, True)
        found = await anna.get("api/commands")
        assert found["commands"] == []


async def test_requests_that_make_no_sense_are_answered_by_what_to_do(tmp_path: Path) -> None:
    async with served(tmp_path, UNREACHABLE) as address, operator(address, "anna") as anna:

        async def status(method: str, path: str, **request: Any) -> int:
            code, answer = await anna.request(method, path, **request)
            assert answer["error"]
            return code

        assert await status("POST", "api/commands", data=b"\xff{") == 400
        assert await status("POST", "api/commands", data=b"[" * 100_000) == 400
        for number in (b"1" * 200_000, b"1" * 400, b"-1e999", b"NaN", b"Infinity"):
            assert await status("POST", "api/commands", data=b'{"lifetime": %b}' % number) == 400
        match = {"If-Match": '"' + "1" * 5000 + '"'}
        assert await status("DELETE", "api/objects/none", headers=match) == 428
        assert await status("POST", "api/commands", data=BytesIO(b"1" * 2_000_000)) == 413
        assert await status("GET", "api/nothing") == 404
        assert await status("GET", "api/tm/jackal/POS_X?size=0") == 422
        assert await status("GET", "api/tm/jackal/POS_X?start=nan") == 422
        assert await status("GET", "api/tm/jackal/POS_X?strategy=all") == 422
        assert await status("GET", "api/notifications?limit=100000") == 422
        assert await status("POST", "api/tm:batch", json={"keys": [["jackal"]]}) == 422
        assert await status("POST", "api/authority/jackal", json={"action": "grab"}) == 422
        assert await status("POST", "api/authority/jackal", json={"action": "hand_over"}) == 422
        assert await status("POST", "api/authority/jackal", json={"action": "request"}) == 404
        assert await status("GET", "api/objects/none") == 404
        assert await status("PUT", "api/objects/none", json={"value": 1}) == 428
        assert await status("GET", "api/export?format=xls") == 422
        bad_name = {"X-Rover-Operator": "plan%3Ax"}
        assert await status("POST", "api/stop/jackal", headers=bad_name) == 422


async def test_a_change_is_sent_before_the_first_poll_of_the_archive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SharedObjectRequests, "run", lambda _: asyncio.sleep(3600.0))
    async with at_console(tmp_path, UNREACHABLE, "anna", "ben") as (anna, ben):
        await anna.request("PUT", "api/objects/plot", json={"value": 1}, headers=IF_NEW)
        await ben.page.until(lambda message: (message["ty"], message.get("revision")) == ("obj", 1))


async def test_objects_are_shared_by_revision(tmp_path: Path) -> None:
    async with at_console(tmp_path, UNREACHABLE, "anna", "ben") as (anna, ben):
        first = await anna.request("PUT", "api/objects/plot", json={"value": [1]}, headers=IF_NEW)
        assert first == (200, {"key": "plot", "revision": 1})
        await ben.page.until(lambda message: (message["ty"], message.get("revision")) == ("obj", 1))
        match = {"If-Match": '"1"'}
        changed = await ben.request("PUT", "api/objects/plot", json={"value": [2]}, headers=match)
        assert changed[1]["revision"] == 2
        late = await anna.request("PUT", "api/objects/plot", json={"value": [3]}, headers=match)
        assert (late[0], late[1]["revision"]) == (412, 2)
        found = await anna.get("api/objects/plot")
        assert (found["value"], found["operator"]) == ([2], "ben")
        assert (await anna.get("api/objects"))["objects"] == [{"key": "plot", "revision": 2}]
        closed = await anna.request("DELETE", "api/objects/plot", headers={"If-Match": '"2"'})
        assert closed[0] == 204


async def test_an_invalid_message_of_a_page_closes_its_socket_with_the_reason(
    tmp_path: Path,
) -> None:
    async with served(tmp_path, UNREACHABLE) as address, ClientSession() as browser:
        for message in (
            '{"op": "sub"}',
            "[]",
            "{",
            '{"op": "hello"}',
            '{"op": "hello", "console": 1}',
            '{"op": "hello", "console": "A", "resume": {"seq": %s}}' % ("1" * 5000),
        ):
            async with browser.ws_connect(f"{address}ws") as page:
                await page.send_str(message)
                await page.receive()
                assert page.close_code == WSCloseCode.POLICY_VIOLATION


async def test_with_tokens_only_a_holder_gets_in_under_its_name(tmp_path: Path) -> None:
    tokens = tmp_path / "tokens"
    tokens.write_text(TOKENS)
    ends = certified(tmp_path, "console")["console"]
    tls = (ends.certificate, ends.key)
    trusted = ssl.create_default_context(cafile=ends.authorities)
    async with served(tmp_path, UNREACHABLE, host="0.0.0.0", tokens=tokens, tls=tls) as address:
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
            stored = {"Cookie": cookie.partition(";")[0]}
            async with browser.ws_connect(f"{there}ws", headers=stored) as page:
                await page.send_json({"op": "hello", "console": "A", "operator": "anna"})
                assert (await page.receive_json())[0]["operator"] == "Ben the second"


NOT_FOUND, BAD_REQUEST, FORBIDDEN, UNAUTHORIZED = b"404", b"400", b"403", b"401"
UPGRADE = b"Upgrade: websocket\r\nConnection: upgrade\r\nSec-WebSocket-Version: 13\r\n"
BEARER = b"Authorization: Bearer 0123456789abcdef\r\n"
MALFORMED = [
    (b"GET /api/dictionary", b"Authorization: Bearer \xff\xfe", UNAUTHORIZED),
    (b"GET /api/dictionary", b"Cookie: rover_console=\xff", UNAUTHORIZED),
    (b"GET /ws", UPGRADE + b"Cookie: rover_console=\xff", UNAUTHORIZED),
    (b"GET /ws", UPGRADE + BEARER + b"Sec-WebSocket-Key: \xff", BAD_REQUEST),
    (b"POST /api/stop/NOBODY", b"Authorization: Bearer \xff", UNAUTHORIZED),
    (b"GET /api/dictionary", b"Origin: http://[", FORBIDDEN),
    (b"GET /", b"Origin: \xff", FORBIDDEN),
    (b"POST /api/login", b"Content-Type: application/json; charset=none", BAD_REQUEST),
    (b"GET /" + b"a" * 300, b"X: y", NOT_FOUND),
]


@pytest.mark.parametrize(("line", "head", "status"), MALFORMED)
async def test_malformed_octets_before_a_login_are_an_error_of_the_client(
    line: bytes, head: bytes, status: bytes, tmp_path: Path
) -> None:
    (tmp_path / "tokens").write_text(TOKENS)
    async with served(tmp_path, UNREACHABLE, tokens=tmp_path / "tokens") as address:
        message = await _answer(address, line, b"Host: localhost\r\n" + head)
    assert message.split()[1] == status


@pytest.mark.parametrize("host", [b"[", b"[::1", b"\xff"])
async def test_a_malformed_host_is_no_host_of_this_computer(host: bytes, tmp_path: Path) -> None:
    async with served(tmp_path, UNREACHABLE) as address:
        message = await _answer(address, b"GET /api/dictionary", b"Host: " + host)
    assert message.split()[1] == FORBIDDEN


async def _answer(address: str, line: bytes, head: bytes) -> bytes:
    """Return the first line of the answer to a request that is written octet by octet."""
    reader, writer = await asyncio.open_connection(*urlsplit(address).netloc.split(":"))
    operator_and_length = b"X-Rover-Operator: anna\r\nContent-Length: 2\r\n"
    writer.write(line + b" HTTP/1.1\r\n" + operator_and_length + head + b"\r\n\r\n{}")
    message = await reader.readline()
    writer.close()
    await writer.wait_closed()
    return message


def test_guesses_wait_by_address_and_right_tokens_at_most_as_long() -> None:
    now_s = 100.0
    guesses = TokenGuesses(lambda: now_s)
    waits = [guesses.wait_s("guesser", None) for _ in range(100)]
    assert waits[:4] == [0.0, GUESS_S, 2 * GUESS_S, 3 * GUESS_S]
    assert max(waits) == MAX_WAIT_S
    assert guesses.wait_s("elsewhere", "anna") == 0.0
    assert guesses.wait_s("guesser", "anna") == MAX_WAIT_S, "as late as a wrong one"
    assert guesses.wait_s("guesser", "anna") == 0.0, "whoever has proved it is held up no more"
    assert guesses.wait_s("guesser", "ben") == MAX_WAIT_S
    now_s += MAX_WAIT_S
    assert guesses.wait_s("guesser", None) == 0.0


def test_the_record_of_guesses_is_bounded() -> None:
    guesses = TokenGuesses(lambda: 0.0)
    for number in range(2 * MAX_PEERS):
        guesses.wait_s(str(number), None)
        guesses.wait_s(str(number), "anna")
    assert guesses.wait_s(str(2 * MAX_PEERS - 1), None) == GUESS_S
    assert guesses.wait_s("0", None) == 0.0, "the oldest are forgotten"


async def test_wrong_tokens_are_answered_later_and_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[float] = []

    async def sleep(wait_s: float) -> None:
        waits.append(wait_s)

    monkeypatch.setattr(access, "asyncio", SimpleNamespace(sleep=sleep))
    (tmp_path / "tokens").write_text(TOKENS)
    async with served(tmp_path, UNREACHABLE, tokens=tmp_path / "tokens") as address:
        async with operator(address, "x", Authorization="Bearer guess") as guesser:
            for path in ("dictionary", "authority", "dictionary"):
                assert (await guesser.request("GET", f"api/{path}"))[0] == 401
            assert (await guesser.post("api/login", token="guess"))[0] == 401
        assert [round(each, 1) for each in waits] == pytest.approx([0.5, 1.0, 1.5], abs=0.4)
        async with operator(address, "x", Authorization="Bearer 0123456789abcdef") as anna:
            assert (await anna.request("GET", "api/dictionary"))[0] == 200
            assert (await anna.request("POST", "api/stop/NOBODY"))[0] == 404
        async with operator(address, "x") as nameless:
            assert (await nameless.request("GET", "api/dictionary"))[0] == 401
    assert len(waits) == 4, "neither who has proved a token waits nor who gives none"


async def test_a_stop_of_no_rover_is_not_logged_as_one(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    async with served(tmp_path, UNREACHABLE) as address, operator(address, "anna") as anna:
        assert (await anna.request("POST", "api/stop/NOBODY"))[0] == 404
    assert not [each for each in caplog.messages if "stop" in each]


async def test_the_answer_to_a_head_has_no_body(tmp_path: Path) -> None:
    """The end of a compressed body would be taken for the next answer of the connection."""
    async with served(tmp_path, UNREACHABLE) as address:
        host = urlsplit(address).netloc
        reader, writer = await asyncio.open_connection(*host.split(":"))
        head = f"HEAD / HTTP/1.1\r\nHost: {host}\r\nAccept-Encoding: deflate\r\n"
        writer.write(f"{head}Connection: close\r\n\r\n".encode())
        message, _, body = (await reader.read()).partition(b"\r\n\r\n")
        writer.close()
        await writer.wait_closed()
        assert (message.split(b"\r\n")[0], body) == (b"HTTP/1.1 200 OK", b"")


async def test_if_reachable_by_others_the_start_reports_the_requirements(tmp_path: Path) -> None:
    with refused("--tokens FILE (lines NAME TOKEN) for login, and --tls-certificate PEM"):
        async with served(tmp_path, UNREACHABLE, host="0.0.0.0"):
            pass
    with refused("--host no-such-host.invalid: Name or service not known"):
        async with served(tmp_path, UNREACHABLE, host="no-such-host.invalid"):
            pass
    async with served(tmp_path, UNREACHABLE, host="[::1]") as address:
        assert address.startswith("http://[::1]:")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with refused("choose another with --port"):
            async with served(tmp_path, UNREACHABLE, port=taken.getsockname()[1]):
                pass
    async with served(tmp_path, UNREACHABLE):
        with refused("another process"):
            async with served(tmp_path, UNREACHABLE):
                pass


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no line NAME TOKEN"),
        ("anna short", "line 1: write NAME TOKEN"),
        ("0123456789abcdef", "line 1: write NAME TOKEN"),
        ("plan:x 0123456789abcdef", "line 1: write NAME TOKEN"),
        ("anna 0123456789abcdef\nben 0123456789abcdef", "line 2: duplicate token"),
    ],
)
def test_an_invalid_token_file_is_reported(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "tokens").write_text(text)
    with refused(message):
        read_tokens(tmp_path / "tokens")


async def test_with_one_certificate_operators_take_turns(tmp_path: Path, launch: Launch) -> None:
    ends = certified(tmp_path, "rover", "MCC")
    rover = launch(terms=TransportSettings(certificates=ends["rover"]), authority=NEEDED)
    rover.runs = True
    terms = TransportSettings(certificates=ends["MCC"])
    async with at_console(tmp_path, rover.uri, "anna", "ben", terms=terms) as (anna, ben):
        await anna.page.is_up()
        status, held = await anna.authority("request")
        assert (status, held["holder"], held["operator"]) == (200, "MCC", "anna")
        assert (await anna.send("a", "moveForward", distance=0.5))[1]["source"] == "MCC"
        await ben.page.command("a", "executed")
        assert (await ben.send("b", "moveForward", distance=0.5))[0] == 403
        status, refusal = await ben.authority("request")
        assert (status, refusal["holder"]) == (403, "anna")
        await anna.page.until(lambda message: message.get("requested_by") == "ben")
        assert (await anna.authority("hand_over", to="ben"))[1]["operator"] == "ben"
        assert (await anna.send("c", "moveForward", distance=0.5))[0] == 403
        assert (await ben.send("d", "moveForward", distance=0.5))[0] == 202
        await anna.page.command("d", "executed")
        assert (await anna.request("POST", "api/stop/jackal"))[0] == 202
        await ben.page.until(lambda message: message.get("mode") == "STOPPED")


async def test_a_page_that_has_not_changed_is_answered_without_a_body(tmp_path: Path) -> None:
    """What came after the head would be taken for the next answer of the connection."""
    async with served(tmp_path, UNREACHABLE) as address, operator(address, "anna") as anna:
        async with anna.session.get(f"{address}app/views/files.js") as first:
            assert first.headers["Content-Encoding"] == "deflate"
            tag = first.headers["ETag"]
        host = urlsplit(address).netloc
        reader, writer = await asyncio.open_connection(*host.split(":"))
        head = f"GET /app/views/files.js HTTP/1.1\r\nHost: {host}\r\nAccept-Encoding: deflate\r\n"
        writer.write(f"{head}If-None-Match: {tag}\r\nConnection: close\r\n\r\n".encode())
        message, _, body = (await reader.read()).partition(b"\r\n\r\n")
        writer.close()
        await writer.wait_closed()
        assert (message.split(b"\r\n")[0], body) == (b"HTTP/1.1 304 Not Modified", b"")
