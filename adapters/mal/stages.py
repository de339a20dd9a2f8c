"""Which messages a pattern has, and the parts of each, those of the MAL itself included."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from adapters.mal.specification import Field, Pattern, Stage, TypeRef

_MESSAGES: Final = {
    Pattern.SEND: {"send": Stage.SEND},
    Pattern.SUBMIT: {"submit": Stage.SUBMIT},
    Pattern.REQUEST: {"request": Stage.REQUEST, "response": Stage.REQUEST_RESPONSE},
    Pattern.INVOKE: {
        "invoke": Stage.INVOKE,
        "acknowledgement": Stage.INVOKE_ACK,
        "response": Stage.INVOKE_RESPONSE,
    },
    Pattern.PROGRESS: {
        "progress": Stage.PROGRESS,
        "acknowledgement": Stage.PROGRESS_ACK,
        "update": Stage.PROGRESS_UPDATE,
        "response": Stage.PROGRESS_RESPONSE,
    },
    Pattern.PUBSUB: {"publishNotify": Stage.PUBLISH},
}
"""The names that a specification gives to the messages it defines."""

_ID: Final = Field("subscriptionId", TypeRef("MAL", "Identifier"))
_UPDATE: Final = Field("updateHeader", TypeRef("MAL", "UpdateHeader"))
_NAMES: Final = TypeRef("MAL", "Identifier", is_list=True)

REPLY: Final = {
    Stage.SUBMIT: Stage.SUBMIT_ACK,
    Stage.REQUEST: Stage.REQUEST_RESPONSE,
    Stage.INVOKE: Stage.INVOKE_ACK,
    Stage.PROGRESS: Stage.PROGRESS_ACK,
    Stage.REGISTER: Stage.REGISTER_ACK,
    Stage.PUBLISH_REGISTER: Stage.PUBLISH_REGISTER_ACK,
    Stage.PUBLISH: Stage.PUBLISH,
    Stage.DEREGISTER: Stage.DEREGISTER_ACK,
    Stage.PUBLISH_DEREGISTER: Stage.PUBLISH_DEREGISTER_ACK,
}
"""The message that answers an initiating one; an error has the number of the reply it replaces."""


def stage_parts(
    pattern: Pattern, messages: Mapping[str, tuple[Field, ...]]
) -> Mapping[Stage, tuple[Field, ...]]:
    """The parts of every message of a pattern.

    Args:
        pattern: The interaction pattern.
        messages: The parts of the messages that the specification defines, by their names there.

    Returns:
        Stage to parts, in the order in which they are sent.
    """
    parts = {stage: messages.get(name, ()) for name, stage in _MESSAGES[pattern].items()}
    match pattern:
        case Pattern.SUBMIT:
            parts[Stage.SUBMIT_ACK] = ()
        case Pattern.PUBSUB:
            update = (_UPDATE, *parts[Stage.PUBLISH])
            parts = {
                Stage.REGISTER: (Field("subscription", TypeRef("MAL", "Subscription")),),
                Stage.REGISTER_ACK: (),
                Stage.PUBLISH_REGISTER: (
                    Field("keyNames", _NAMES),
                    Field("keyTypes", TypeRef("MAL", "AttributeType", is_list=True)),
                ),
                Stage.PUBLISH_REGISTER_ACK: (),
                Stage.PUBLISH: update,
                Stage.NOTIFY: (_ID, *update),
                Stage.DEREGISTER: (Field("subscriptionIds", _NAMES),),
                Stage.DEREGISTER_ACK: (),
                Stage.PUBLISH_DEREGISTER: (),
                Stage.PUBLISH_DEREGISTER_ACK: (),
            }
        case _:
            pass
    return MappingProxyType(parts)
