"""Requests and pages: who may ask, how it is answered, what is told."""

from adapters.console.web.access import OPERATOR, Access, read_tokens
from adapters.console.web.answers import (
    HIGHEST,
    MOST_OCTETS,
    Handler,
    RefusedError,
    answer,
    body_of,
    count_of,
    json_answer,
    number_of,
    one_of,
    page_of,
    refusals,
    refused,
    text_of,
)
from adapters.console.web.hub import KEPT, KEPT_COMMANDS, MOST_SAMPLES, MOST_WAITING, Hub
from adapters.console.web.shared_presence import GONE_S, SharedPresence
from adapters.console.web.sockets import Sockets

__all__ = [
    "GONE_S",
    "HIGHEST",
    "KEPT",
    "KEPT_COMMANDS",
    "MOST_OCTETS",
    "MOST_SAMPLES",
    "MOST_WAITING",
    "OPERATOR",
    "Access",
    "Handler",
    "Hub",
    "RefusedError",
    "SharedPresence",
    "Sockets",
    "answer",
    "body_of",
    "count_of",
    "json_answer",
    "number_of",
    "one_of",
    "page_of",
    "read_tokens",
    "refusals",
    "refused",
    "text_of",
]
