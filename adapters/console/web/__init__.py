"""Web layer: access control, responses, and messages to pages."""

from adapters.console.web.access import OPERATOR as OPERATOR
from adapters.console.web.access import Access as Access
from adapters.console.web.access import read_tokens as read_tokens
from adapters.console.web.hub import MAX_QUEUED as MAX_QUEUED
from adapters.console.web.hub import MAX_QUEUED_SAMPLES as MAX_QUEUED_SAMPLES
from adapters.console.web.hub import MAX_REPLAYED_COMMANDS as MAX_REPLAYED_COMMANDS
from adapters.console.web.hub import REPLAY_BUFFER as REPLAY_BUFFER
from adapters.console.web.hub import Hub as Hub
from adapters.console.web.responses import MAX_BODY_OCTETS as MAX_BODY_OCTETS
from adapters.console.web.responses import MAX_NUMBER as MAX_NUMBER
from adapters.console.web.responses import Handler as Handler
from adapters.console.web.responses import RequestError as RequestError
from adapters.console.web.responses import body_of as body_of
from adapters.console.web.responses import count_of as count_of
from adapters.console.web.responses import error_middleware as error_middleware
from adapters.console.web.responses import json_answer as json_answer
from adapters.console.web.responses import json_response as json_response
from adapters.console.web.responses import number_of as number_of
from adapters.console.web.responses import one_of as one_of
from adapters.console.web.responses import page_of as page_of
from adapters.console.web.responses import refused as refused
from adapters.console.web.responses import text_of as text_of
from adapters.console.web.shared_presence import PRESENCE_TIMEOUT_S as PRESENCE_TIMEOUT_S
from adapters.console.web.shared_presence import SharedPresence as SharedPresence
from adapters.console.web.sockets import Sockets as Sockets
