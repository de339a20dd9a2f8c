"""`serve_authority`: the service Authority, with holder, requests and hand-over."""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from adapters.mal import CallContext
from adapters.mrs.aboard.gateway import CoreGateway, Reply
from adapters.mrs.aboard.served_operations import PeerRateLimiter, ServedOperations
from adapters.mrs.spec import AreaError, AuthorityStatus, refusal_error, with_text
from executive.core.authority import AuthorityAction, AuthorityRequest, AuthorityState
from executive.core.runner import Executive
from executive.values.reasons import Refusal
from executive.values.reports import Identity

Result = AuthorityState | Refusal
Act = Callable[[Executive, Callable[[Result], None]], None]

REQUESTS_HZ: Final = 10
"""Maximum requests a second of one peer: each change of holder is stored and broadcast."""


def serve_authority(served: ServedOperations, gateway: CoreGateway) -> None:
    """Serve the authority of an executive; all operations but getAuthority name the requester."""
    rate = PeerRateLimiter(REQUESTS_HZ, asyncio.get_running_loop().time)

    def serve(operation: str, act: Callable[..., Act]) -> None:
        def handler(call: CallContext, *parts: Any) -> Any:
            if parts:
                rate.admit(call.peer_name or call.connection.peer_host)
                _require_name(parts[0], call.peer_name)

            def question(executive: Executive, reply: Reply[tuple[AuthorityStatus]]) -> None:
                act(*parts)(
                    executive, lambda result: reply(lambda: (_status(result, call.peer_name),))
                )

            answer = gateway.query_later(question)
            if parts:
                served.prioritize(
                    call.connection, answer, lambda reply: reply[0].holder == parts[0]
                )
            return answer

        served.serve("Authority", operation, handler)

    serve("getAuthority", lambda: lambda executive, reply: reply(executive.authority.state))
    serve("requestAuthority", partial(_authority_query, AuthorityAction.REQUEST))
    serve("handOver", partial(_authority_query, AuthorityAction.HAND_OVER))
    serve("takeAuthority", partial(_authority_query, AuthorityAction.TAKE))
    serve("releaseAuthority", partial(_authority_query, AuthorityAction.RELEASE))


def _authority_query(act: AuthorityAction, *parts: Any) -> Act:
    request = AuthorityRequest(act, *parts)
    return lambda executive, reply: executive.request_authority(request, reply)


def _require_name(source: str, peer_name: str | None) -> None:
    if peer_name not in {None, source}:
        raise with_text(AreaError.REJECTED, f"source {source}: the certificate names {peer_name}")


def _status(found: Result, caller: str | None) -> AuthorityStatus:
    if isinstance(found, Refusal):
        raise refusal_error(found, Identity("", 0))
    return AuthorityStatus(
        holder=found.holder,
        epoch=found.epoch,
        leaseLeft=found.lease_left_s,
        lease=found.lease_s,
        requestedBy=found.requested_by,
        needed=found.needed,
        caller=caller,
    )
