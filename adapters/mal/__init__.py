"""CCSDS MAL 521.0-B-3 over TCP, as implemented by mo-services-java 12; see the README."""

from adapters.mal.attribute_codec import Encoding
from adapters.mal.broker import Keys, Publisher
from adapters.mal.codec import Codec
from adapters.mal.connection import SCHEME, Connection, MalUri
from adapters.mal.consumer import Consumer, Publication
from adapters.mal.errors import (
    DecodeError,
    EncodeError,
    MalError,
    SpecificationError,
    StandardError,
)
from adapters.mal.interaction import Call, Handler, Interaction, UpdateError
from adapters.mal.message import Header, encode_message
from adapters.mal.provider import Provider
from adapters.mal.specification import (
    Area,
    CompositeType,
    EnumerationType,
    Field,
    Operation,
    Pattern,
    Service,
    Specification,
    Stage,
)
from adapters.mal.specification_xml import load_specification
from adapters.mal.tls import CertificateError, Certificates
from adapters.mal.transactions import Invocation, OnUpdate, Progress
from adapters.mal.values import (
    AttributeType,
    NamedValue,
    NullableAttribute,
    Object,
    ObjectIdentity,
    ObjectRef,
    ServiceId,
    Subscription,
    SubscriptionFilter,
    Typed,
    TypedList,
    UpdateHeader,
)

__all__ = [
    "SCHEME",
    "Area",
    "AttributeType",
    "Call",
    "CertificateError",
    "Certificates",
    "Codec",
    "CompositeType",
    "Connection",
    "Consumer",
    "DecodeError",
    "EncodeError",
    "Encoding",
    "EnumerationType",
    "Field",
    "Handler",
    "Header",
    "Interaction",
    "Invocation",
    "Keys",
    "MalError",
    "MalUri",
    "NamedValue",
    "NullableAttribute",
    "Object",
    "ObjectIdentity",
    "ObjectRef",
    "OnUpdate",
    "Operation",
    "Pattern",
    "Progress",
    "Provider",
    "Publication",
    "Publisher",
    "Service",
    "ServiceId",
    "Specification",
    "SpecificationError",
    "Stage",
    "StandardError",
    "Subscription",
    "SubscriptionFilter",
    "Typed",
    "TypedList",
    "UpdateError",
    "UpdateHeader",
    "encode_message",
    "load_specification",
]
