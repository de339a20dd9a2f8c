"""Web layer: access control, responses, and messages to pages."""

from adapters.console.web.access import OPERATOR as OPERATOR
from adapters.console.web.access import Access as Access
from adapters.console.web.access import read_tokens as read_tokens
from adapters.console.web.answers import HIGHEST as HIGHEST
from adapters.console.web.answers import MOST_OCTETS as MOST_OCTETS
from adapters.console.web.answers import Handler as Handler
from adapters.console.web.answers import RequestError as RequestError
from adapters.console.web.answers import answer as answer
from adapters.console.web.answers import body_of as body_of
from adapters.console.web.answers import count_of as count_of
from adapters.console.web.answers import json_answer as json_answer
from adapters.console.web.answers import number_of as number_of
from adapters.console.web.answers import one_of as one_of
from adapters.console.web.answers import page_of as page_of
from adapters.console.web.answers import refusals as refusals
from adapters.console.web.answers import refused as refused
from adapters.console.web.answers import text_of as text_of
from adapters.console.web.hub import KEPT as KEPT
from adapters.console.web.hub import KEPT_COMMANDS as KEPT_COMMANDS
from adapters.console.web.hub import MOST_SAMPLES as MOST_SAMPLES
from adapters.console.web.hub import MOST_WAITING as MOST_WAITING
from adapters.console.web.hub import Hub as Hub
from adapters.console.web.shared_presence import GONE_S as GONE_S
from adapters.console.web.shared_presence import SharedPresence as SharedPresence
from adapters.console.web.sockets import Sockets as Sockets
