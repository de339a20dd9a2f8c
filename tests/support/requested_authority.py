"""The authority over a bench, asked for as links do: in a turn of the core."""

from executive.core.authority import AuthorityAction, AuthorityRequest, AuthorityState
from executive.values.reasons import Refusal
from tests.support.kinematic import Bench


class RequestedAuthority:
    """Asks the executive of a bench, whichever runs now."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    @property
    def state(self) -> AuthorityState:
        return self._bench.executive.authority.state

    def request(self, source: str) -> AuthorityState | Refusal:
        return self._request(AuthorityRequest(AuthorityAction.REQUEST, source))

    def take(self, source: str) -> AuthorityState | Refusal:
        return self._request(AuthorityRequest(AuthorityAction.TAKE, source))

    def hand_over(
        self, source: str, epoch: int, to: str, lease_s: float | None = None
    ) -> AuthorityState | Refusal:
        return self._request(
            AuthorityRequest(AuthorityAction.HAND_OVER, source, epoch, to, lease_s)
        )

    def release(self, source: str, epoch: int) -> AuthorityState | Refusal:
        return self._request(AuthorityRequest(AuthorityAction.RELEASE, source, epoch))

    def _request(self, requested: AuthorityRequest) -> AuthorityState | Refusal:
        executive, answers = self._bench.executive, list[AuthorityState | Refusal]()
        executive.query(lambda: executive.request_authority(requested, answers.append))
        executive.serve_inbox()
        (answer,) = answers
        return answer
