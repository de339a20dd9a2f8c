"""HTTP requests for the explanation of a command, or of an asset's present state."""

from dataclasses import dataclass
from datetime import UTC, datetime
from http import HTTPStatus

from aiohttp import web

from adapters.console.recordings import Recordings
from adapters.console.requests.commanding import Commanding
from adapters.console.web import json_response, refused
from adapters.explanation import (
    Explanation,
    UnknownCommandError,
    explain_command,
    explain_now,
    explanation_lines,
)
from executive.history import RunHistory


@dataclass(frozen=True, slots=True)
class ExplanationStepBody:
    """A step of an explanation.

    Attributes:
        utc: time by the onboard clock; None for a step without a time.
    """

    utc: float | None
    text: str


@dataclass(frozen=True, slots=True)
class ExplanationBody:
    """An explanation.

    Attributes:
        headline: explanation in one sentence.
        reason, code: name and number of the underlying reason, if any.
        evidence: figures that prove it.
        lines: complete human-readable text.
    """

    headline: str
    reason: str | None
    code: int | None
    steps: tuple[ExplanationStepBody, ...]
    evidence: tuple[str, ...]
    lines: tuple[str, ...]


class ExplanationRequests:
    """Serves these requests.

    Args:
        commanding: access to assets and commands.
        recordings: opened recordings.
    """

    def __init__(self, commanding: Commanding, recordings: Recordings) -> None:
        self._commanding = commanding
        self._recordings = recordings

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [
            web.get("/api/why/{asset}", self._why),
            web.get("/api/why/{asset}/{command}", self._why),
        ]

    async def _why(self, request: web.Request) -> web.Response:
        asset, name = request.match_info["asset"], request.match_info.get("command")
        recording = self._recordings.find(asset)
        try:
            if recording is not None:
                explanation = _explain(recording.history, name)
            else:
                identity = None if name is None else await self._commanding.identity(name)
                history = await self._commanding.query(
                    asset, lambda client: client.get_history(identity)
                )
                explanation = _explain(history, identity)
        except UnknownCommandError as error:
            raise refused(HTTPStatus.NOT_FOUND, str(error), field="command") from error
        return json_response(_explanation_body(explanation))


def _explain(history: RunHistory, identity: str | None) -> Explanation:
    return explain_now(history) if identity is None else explain_command(history, identity)


def _explanation_body(explanation: Explanation) -> ExplanationBody:
    reason = explanation.reason
    return ExplanationBody(
        headline=explanation.headline,
        reason=None if reason is None else reason.name,
        code=None if reason is None else reason.value,
        steps=tuple(ExplanationStepBody(each.utc_s, each.text) for each in explanation.steps),
        evidence=tuple(map(str, explanation.evidence)),
        lines=tuple(explanation_lines(explanation, _clock)),
    )


def _clock(utc_s: float) -> str:
    at = datetime.fromtimestamp(utc_s, UTC)
    return f"{at:%Y-%m-%d %H:%M:%S}.{at.microsecond // 10_000:02d}"
